"""What sums of blocks say about the judged states where double precision does not tell: in twice the digits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.round_off import resolution
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


def ldl_factor(V: DoubleDouble, order: np.ndarray, nuisance: int) -> LDLFactors:
    """Return the factors of V (n, n, N), its states in this order; the first `nuisance` of them are not judged."""
    n = len(order)
    A = V[0][np.ix_(order, order)].copy(), V[1][np.ix_(order, order)].copy()
    L = np.zeros_like(A[0]) + np.eye(n)[:, :, None], np.zeros_like(A[0])
    diagonal, pivots = A[0][np.arange(n), np.arange(n)].T.copy(), np.zeros((A[0].shape[2], n))
    for j in range(n):
        pivots[:, j] = A[0][j, j]
        threshold = _ZERO_PIVOT * diagonal[:, j] if j < nuisance else 0.0
        is_nonzero = pivots[:, j] > threshold
        pivot = np.where(is_nonzero, A[0][j, j], 1.0), np.where(is_nonzero, A[1][j, j], 0.0)
        below = slice(j + 1, n)
        column = take(A, below, j)
        quotient = divide(column, pivot)
        multiplier = np.where(is_nonzero, quotient[0], 0.0), np.where(is_nonzero, quotient[1], 0.0)
        put(L, (below, j), multiplier)
        update = multiply((multiplier[0][:, None], multiplier[1][:, None]), (column[0][None], column[1][None]))
        put(A, (below, below), subtract(take(A, below, below), update))
    return LDLFactors(_inverse(L), pivots, diagonal)


def _inverse(L: DoubleDouble) -> np.ndarray:
    """L^-1 (N, n, n) of unit lower triangles (n, n, N)."""
    n = len(L[0])
    X = np.zeros_like(L[0]) + np.eye(n)[:, :, None], np.zeros_like(L[0])
    for i in range(n):
        for j in range(i):
            put(X, i, subtract(take(X, i), multiply((L[0][i, j][None], L[1][i, j][None]), take(X, j))))
    return np.moveaxis(X[0], 2, 0)


def covariance_roots(factors: LDLFactors, nuisance: int) -> tuple[np.ndarray, np.ndarray]:
    """Return R (N, k, k) with R'R what the judged states' covariance is, and which (N,) have one at all."""
    pivots, diagonal = factors.pivots[:, nuisance:], factors.diagonal[:, nuisance:]
    smallest = _PIVOT_FLOOR * np.where(diagonal > 0, diagonal, 1.0)
    return factors.inverse_factor[:, nuisance:, nuisance:] / np.sqrt(np.maximum(pivots, smallest))[:, :, None], np.all(
        pivots > smallest, axis=1
    )


def doubtful_directions(factors: LDLFactors, R: np.ndarray, nuisance: int) -> tuple[np.ndarray, np.ndarray]:
    """Return directions (N, n, k) of all states in the order of `factors`, and which (N, k) are round-off of the sum's own sizes.

    The eigenvectors of R'R with the judged states in units of the sum's sizes, the nuisance states following as V asks for:
    no other nuisance makes less of the direction.
    """
    scale = np.sqrt(np.where(factors.diagonal[:, nuisance:] > 0, factors.diagonal[:, nuisance:], 1.0))
    scaled = R * scale[:, None, :]
    _, singular_values, right_vectors = np.linalg.svd(scaled)
    n = factors.diagonal.shape[1]
    directions = np.zeros((len(R), n, R.shape[2]))
    judged_part = right_vectors.swapaxes(1, 2) / scale[:, :, None]
    directions[:, nuisance:] = judged_part
    if nuisance:
        inverse_judged = factors.inverse_factor[:, nuisance:, nuisance:].swapaxes(1, 2)
        directions[:, :nuisance] = factors.inverse_factor[:, nuisance:, :nuisance].swapaxes(1, 2) @ np.linalg.solve(
            inverse_judged, judged_part
        )
    return directions, singular_values >= resolution(n) ** -0.5


def sees_directions(blocks: np.ndarray, on: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return whether (N, k) a block (M, n, n) that is on (N, M) sees directions (N, n, k) beyond its own round-off.

    v'W v > 8 n eps (sum_i sqrt(W_ii) |v_i|)^2, in any units: an entry W_ij is known to 8 eps sqrt(W_ii W_jj).
    """
    sizes = np.sqrt(np.maximum(np.diagonal(blocks, axis1=1, axis2=2), 0.0))
    is_seen = np.zeros((len(on), directions.shape[2]), dtype=bool)
    for seen_row, active, v in zip(is_seen, on, directions, strict=True):
        contribution = np.einsum("mik,ik->mk", blocks[active] @ v, v)
        seen_row[:] = (contribution > resolution(len(v)) * (sizes[active] @ np.abs(v)) ** 2).any(axis=0)
    return is_seen
