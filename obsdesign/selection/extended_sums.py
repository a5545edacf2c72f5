"""What sums of blocks say about the judged states where double precision does not tell: in twice the digits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.round_off import resolution, spectrum
from obsdesign.selection.double_double import DoubleDouble, add, divide, multiply, put, subtract, take

_ZERO_PIVOT = 1e-26  # of its size: a pivot of a nuisance state that is nothing
_PIVOT_FLOOR = 1e-40  # of its size: what stands for a pivot of 0


@dataclass(frozen=True, eq=False)
class LDLFactors:
    """V = L diag(pivots) L', states in the order nuisance, judged: L^-1 (N, n, n), pivots (N, n), and V's diagonal (N, n)."""

    inverse_factor: np.ndarray
    pivots: np.ndarray
    diagonal: np.ndarray


def exact_sums(rows: np.ndarray, on: np.ndarray) -> DoubleDouble:
    """Return the sums of those rows (M, d) that are on (N, M), as pairs (N, d): halves, of halves, of halves."""
    terms = rows[None] * on[:, :, None]
    total: DoubleDouble = terms, np.zeros_like(terms)
    while (count := total[0].shape[1]) > 1:
        half = count // 2
        pair_sums = add(take(total, slice(None), slice(0, half)), take(total, slice(None), slice(half, 2 * half)))
        rest = slice(2 * half, count)
        total = np.concatenate([pair_sums[0], total[0][:, rest]], axis=1), np.concatenate([pair_sums[1], total[1][:, rest]], axis=1)
    return total[0][:, 0], total[1][:, 0]


def ldl_factor(
    V: DoubleDouble, order: np.ndarray, nuisance: int, blocks: np.ndarray | None = None, on: np.ndarray | None = None
) -> LDLFactors:
    """Return the factors of V (n, n, N), its states in this order; the first `nuisance` of them are not judged.

    A pivot of a nuisance state is v'V v, v the row of L^-1. What is left of it where no block (M, n, n) that is on (N, M) sees v, or by
    itself where no blocks are given, is round-off: 0, with nothing below it.
    """
    n = len(order)
    A = V[0][np.ix_(order, order)].copy(), V[1][np.ix_(order, order)].copy()
    L = np.zeros_like(A[0]) + np.eye(n)[:, :, None], np.zeros_like(A[0])
    X = np.zeros_like(A[0]) + np.eye(n)[:, :, None], np.zeros_like(A[0])
    diagonal, pivots = A[0][np.arange(n), np.arange(n)].T.copy(), np.zeros((A[0].shape[2], n))
    for j in range(n):
        _eliminate_row(X, L, j)
        pivots[:, j] = A[0][j, j]
        if j < nuisance:
            upto = j + 1
            corner = None if blocks is None else blocks[:, :upto, :upto]
            is_nonzero = pivots[:, j] > _ZERO_PIVOT * diagonal[:, j]
            is_nonzero &= ~_is_round_off(pivots[:, j], X[0][j, :upto].T, diagonal[:, :upto], corner, on)
        else:
            is_nonzero = pivots[:, j] > 0.0
        _eliminate_column(A, L, j, is_nonzero)
    return LDLFactors(np.moveaxis(X[0], 2, 0), pivots, diagonal)


def _eliminate_row(X: DoubleDouble, L: DoubleDouble, j: int) -> None:
    """Row j of X = L^-1 (n, n, N) of unit lower triangles, from those above it; in place."""
    for i in range(j):
        put(X, j, subtract(take(X, j), multiply((L[0][j, i][None], L[1][j, i][None]), take(X, i))))


def _eliminate_column(A: DoubleDouble, L: DoubleDouble, j: int, is_nonzero: np.ndarray) -> None:
    """Column j of L, and what it leaves of A (n, n, N), where (N,) its pivot is not 0; in place."""
    below = slice(j + 1, A[0].shape[0])
    pivot = np.where(is_nonzero, A[0][j, j], 1.0), np.where(is_nonzero, A[1][j, j], 0.0)
    column = take(A, below, j)
    quotient = divide(column, pivot)
    multiplier = np.where(is_nonzero, quotient[0], 0.0), np.where(is_nonzero, quotient[1], 0.0)
    put(L, (below, j), multiplier)
    update = multiply((multiplier[0][:, None], multiplier[1][:, None]), (column[0][None], column[1][None]))
    put(A, (below, below), subtract(take(A, below, below), update))


def _is_round_off(
    values: np.ndarray, directions: np.ndarray, diagonal: np.ndarray, blocks: np.ndarray | None, on: np.ndarray | None
) -> np.ndarray:
    """Whether (N,) v'V v is round-off, for directions v (N, p): below that of the sizes of V (N, p), and of every block that is on."""
    is_doubtful = values <= resolution(diagonal.shape[1]) * np.sum(np.sqrt(np.maximum(diagonal, 0.0)) * np.abs(directions), axis=1) ** 2
    if blocks is not None and on is not None:
        last = np.arange(directions.shape[1]) == directions.shape[1] - 1
        for i in np.flatnonzero(is_doubtful):
            is_doubtful[i] = unseen_direction(blocks[on[i]], directions[i], last) is not None
    return is_doubtful


def covariance_roots(factors: LDLFactors, nuisance: int) -> tuple[np.ndarray, np.ndarray]:
    """Return R (N, k, k) with R'R what the judged states' covariance is, and which (N,) have one at all."""
    roots, exists = _judged_rows(factors, nuisance)
    return roots[:, :, nuisance:], exists


def _judged_rows(factors: LDLFactors, nuisance: int) -> tuple[np.ndarray, np.ndarray]:
    """pivots^-1/2 L^-1 (N, k, n), the judged rows of it, and whether (N,) no pivot is 0."""
    pivots, diagonal = factors.pivots[:, nuisance:], factors.diagonal[:, nuisance:]
    smallest = _PIVOT_FLOOR * np.where(diagonal > 0, diagonal, 1.0)
    rows = factors.inverse_factor[:, nuisance:] / np.sqrt(np.maximum(pivots, smallest))[:, :, None]
    return rows, np.all(pivots > smallest, axis=1)


def doubtful_directions(factors: LDLFactors, nuisance: int) -> tuple[np.ndarray, np.ndarray]:
    """Return directions v (N, n, k) of all states in the order of `factors`, and which (N, k) are round-off of the sum's own sizes.

    Where v'V v / sum_i V_ii v_i^2 is stationary over judged parts, the nuisance states following as V asks for: v = X'c with X the judged
    rows of L^-1, v'V v = sum_j pivot_j c_j^2. So pivots^1/2 c are the left singular vectors of pivots^-1/2 X, in units of the sum's sizes.
    Of a direction that is hidden every entry has its digits, however small it is beside the others: it is next to a row of X.
    """
    scale = np.sqrt(np.where(factors.diagonal > 0, factors.diagonal, 1.0))
    roots, _ = _judged_rows(factors, nuisance)
    left_vectors, singular_values, _ = np.linalg.svd(roots * scale[:, None, :], full_matrices=False)
    directions = roots.swapaxes(1, 2) @ left_vectors / np.maximum(singular_values, 1.0)[:, None, :]
    return directions, singular_values >= resolution(scale.shape[1]) ** -0.5


def unseen_direction(blocks: np.ndarray, direction: np.ndarray, judged: np.ndarray) -> np.ndarray | None:
    """Return a direction next to one (n,) that no block (M, n, n) sees beyond its own round-off, None where there is none.

    v'W v <= 8 n eps (sum_i sqrt(W_ii) |v_i|)^2, in any units: an entry W_ij is known to 8 eps sqrt(W_ii W_jj). The round-off of one block
    turns a direction of the sum a little, which another may see that has information about nothing but what is small in it: what blocks
    see is taken off the direction, v - R^+ R v with their rows R in units of the sum's sizes, as long as it moves the judged (n,) bool.
    """
    sizes = np.sqrt(np.maximum(np.diagonal(blocks, axis1=1, axis2=2), 0.0))
    unit = np.sqrt(np.sum(sizes**2, axis=0))
    unit = np.where(unit > 0, unit, 1.0)
    v, rows = direction, np.zeros((0, len(direction)))
    for _ in direction:
        sees = np.einsum("i,mij,j->m", v, blocks, v) > resolution(len(v)) * (sizes @ np.abs(v)) ** 2
        if not sees.any():
            return v
        rows = np.concatenate([rows, _unit_rows(blocks[sees] / unit[:, None] / unit)])
        seen_part = np.linalg.lstsq(rows, rows @ (unit * direction), rcond=resolution(len(v)))[0] / unit
        v = np.where(np.abs(direction - seen_part) > resolution(len(v)) * np.abs(seen_part), direction - seen_part, 0.0)
        if np.linalg.norm((unit * v)[judged]) <= 0.5 * np.linalg.norm((unit * direction)[judged]):
            break
    return None


def _unit_rows(blocks: np.ndarray) -> np.ndarray:
    """Return rows (., n) of length 1 that span what blocks (M, n, n) see beyond their round-off."""
    decomposition = spectrum(blocks)
    rows = (decomposition.V * decomposition.unit_sizes[:, :, None]).swapaxes(1, 2)[~decomposition.is_hidden]
    return rows / np.linalg.norm(rows, axis=1)[:, None]
