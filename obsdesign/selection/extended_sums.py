"""What sums of blocks say about the judged states where double precision does not tell: in twice the digits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.round_off import resolution
from obsdesign.selection.double_double import Pair, at, minus, over, plus, put, times

_NOTHING = 1e-26  # of its size: a pivot of a nuisance state that is nothing
_ENDLESS = 1e-40  # of its size: what stands for a pivot of 0


@dataclass(frozen=True, eq=False)
class Pivots:
    """V = L diag(pivots) L', states in the order nuisance, judged: L^-1 (N, n, n), pivots (N, n), and V's diagonal (N, n)."""

    inverse: np.ndarray
    pivots: np.ndarray
    sizes: np.ndarray


def exact_sums(rows: np.ndarray, on: np.ndarray) -> Pair:
    """Return the sums of those rows (M, d) that are on (N, M), as pairs (N, d): halves, of halves, of halves."""
    terms = rows[None] * on[:, :, None]
    total: Pair = terms, np.zeros_like(terms)
    while (count := total[0].shape[1]) > 1:
        half = count // 2
        added = plus(at(total, slice(None), slice(0, half)), at(total, slice(None), slice(half, 2 * half)))
        rest = slice(2 * half, count)
        total = np.concatenate([added[0], total[0][:, rest]], axis=1), np.concatenate([added[1], total[1][:, rest]], axis=1)
    return total[0][:, 0], total[1][:, 0]


def eliminated(V: Pair, order: np.ndarray, nuisance: int) -> Pivots:
    """Return the factors of V (n, n, N), its states in this order; the first `nuisance` of them are not judged."""
    n = len(order)
    A = V[0][np.ix_(order, order)].copy(), V[1][np.ix_(order, order)].copy()
    L = np.zeros_like(A[0]) + np.eye(n)[:, :, None], np.zeros_like(A[0])
    sizes, pivots = A[0][np.arange(n), np.arange(n)].T.copy(), np.zeros((A[0].shape[2], n))
    for j in range(n):
        pivots[:, j] = A[0][j, j]
        least = _NOTHING * sizes[:, j] if j < nuisance else 0.0
        there = pivots[:, j] > least
        pivot = np.where(there, A[0][j, j], 1.0), np.where(there, A[1][j, j], 0.0)
        rest = slice(j + 1, n)
        column = at(A, rest, j)
        quotient = over(column, pivot)
        share = np.where(there, quotient[0], 0.0), np.where(there, quotient[1], 0.0)
        put(L, (rest, j), share)
        taken = times((share[0][:, None], share[1][:, None]), (column[0][None], column[1][None]))
        put(A, (rest, rest), minus(at(A, rest, rest), taken))
    return Pivots(_inverse(L), pivots, sizes)


def _inverse(L: Pair) -> np.ndarray:
    """L^-1 (N, n, n) of unit lower triangles (n, n, N)."""
    n = len(L[0])
    X = np.zeros_like(L[0]) + np.eye(n)[:, :, None], np.zeros_like(L[0])
    for i in range(n):
        for j in range(i):
            put(X, i, minus(at(X, i), times((L[0][i, j][None], L[1][i, j][None]), at(X, j))))
    return np.moveaxis(X[0], 2, 0)


def roots(found: Pivots, nuisance: int) -> tuple[np.ndarray, np.ndarray]:
    """Return R (N, k, k) with R'R what the judged states' covariance is, and which (N,) have one at all."""
    pivots, sizes = found.pivots[:, nuisance:], found.sizes[:, nuisance:]
    least = _ENDLESS * np.where(sizes > 0, sizes, 1.0)
    return found.inverse[:, nuisance:, nuisance:] / np.sqrt(np.maximum(pivots, least))[:, :, None], np.all(pivots > least, axis=1)


def doubtful_directions(found: Pivots, R: np.ndarray, nuisance: int) -> tuple[np.ndarray, np.ndarray]:
    """Return directions (N, n, k) of all states in the order of `found`, and which (N, k) are round-off of the sum's own sizes.

    The eigenvectors of R'R with the judged states in units of the sum's sizes, the nuisance states following as V asks for:
    no other nuisance makes less of the direction.
    """
    size = np.sqrt(np.where(found.sizes[:, nuisance:] > 0, found.sizes[:, nuisance:], 1.0))
    scaled = R * size[:, None, :]
    _, spread, turned = np.linalg.svd(scaled)
    n = found.sizes.shape[1]
    directions = np.zeros((len(R), n, R.shape[2]))
    judged = turned.swapaxes(1, 2) / size[:, :, None]
    directions[:, nuisance:] = judged
    if nuisance:
        ahead = found.inverse[:, nuisance:, nuisance:].swapaxes(1, 2)
        directions[:, :nuisance] = found.inverse[:, nuisance:, :nuisance].swapaxes(1, 2) @ np.linalg.solve(ahead, judged)
    return directions, spread >= resolution(n) ** -0.5


def seen(blocks: np.ndarray, on: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return whether (N, k) a block (M, n, n) that is on (N, M) sees directions (N, n, k) beyond its own round-off.

    v'W v > 8 n eps (sum_i sqrt(W_ii) |v_i|)^2, in any units: an entry W_ij is known to 8 eps sqrt(W_ii W_jj).
    """
    sizes = np.sqrt(np.maximum(np.diagonal(blocks, axis1=1, axis2=2), 0.0))
    found = np.zeros((len(on), directions.shape[2]), dtype=bool)
    for which, there, v in zip(found, on, directions, strict=True):
        worth = np.einsum("mik,ik->mk", blocks[there] @ v, v)
        which[:] = (worth > resolution(len(v)) * (sizes[there] @ np.abs(v)) ** 2).any(axis=0)
    return found
