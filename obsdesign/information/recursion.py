"""What a step does to information about the state: graphs that the posterior, its use in a design, and its tests share."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

_UNSEEN = 1e-13  # share of its size below which what is known of an input is rounding


@dataclass(frozen=True)
class Disturbance:
    """What moves the state beside its inputs: columns of unknown inputs (indices), and L (n, r), L L' = psd * step, as rows."""

    unknown: tuple[int, ...]
    noise: tuple[tuple[float, ...], ...]

    @property
    def L(self) -> np.ndarray:
        """L (n, r)."""
        return np.array(self.noise)


def symmetric(name: str, n: int) -> tuple[ca.SX, ca.SX]:
    """Return a symmetric matrix (n, n) of symbols and the column (n (n + 1) / 2, 1) of its lower triangle."""
    lower = ca.SX.sym(name, ca.Sparsity.lower(n))
    return ca.tril2symm(lower), lower.nz[:]


def packed(J: ca.SX) -> ca.SX:
    """Return the lower triangle of a symmetric J (n, n) as a column, in the order of `symmetric`."""
    return ca.vertcat(*[J[i, j] for j in range(J.shape[0]) for i in range(j, J.shape[0])])


def packed_values(J: np.ndarray) -> np.ndarray:
    """Return the same entries of numbers (..., n, n)."""
    rows, columns = lower_indices(J.shape[-1])
    return np.ascontiguousarray(J[..., rows, columns])


def unpacked(values: np.ndarray, n: int) -> np.ndarray:
    """Return symmetric matrices (..., n, n) of their lower triangles."""
    rows, columns = lower_indices(n)
    J = np.empty((*values.shape[:-1], n, n))
    J[..., rows, columns] = values
    J[..., columns, rows] = values
    return J


def lower_indices(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns of the lower triangle, column by column."""
    columns, rows = np.triu_indices(n)
    return rows, columns


def predicted(J: ca.SX, F: ca.SX, B_w: ca.SX, disturbance: Disturbance) -> ca.SX:
    """J+ = M - M B (B'M B + Q^-1)^# B'M with M = F^-T J F^-1: what is known of x(t_k+1) of what was known of x(t_k).

    B holds the columns of the unknown inputs, for which Q^-1 = 0, and L, for which it is I.
    """
    inverse = ca.solve(F, ca.SX.eye(F.shape[0]))
    return shaken(inverse.T @ J @ inverse, B_w, disturbance)


def shaken(M: ca.SX, B_w: ca.SX, disturbance: Disturbance) -> ca.SX:
    """M - M B (B'M B + Q^-1)^# B'M, one column of B after the other: each is a sum over a scalar, whatever their number."""
    for column in disturbance.unknown:
        M = _without(M, B_w[:, column], 0.0)
    L = ca.sparsify(ca.SX(ca.DM(disturbance.L)))
    for column in range(L.shape[1]):
        M = _without(M, L[:, column], 1.0)
    return M


def _without(M: ca.SX, b: ca.SX, certainty: float) -> ca.SX:
    """M - M b (b'M b + certainty)^# b'M: information after an input along b, known with that certainty, was eliminated."""
    along = M @ b
    known = b.T @ along + certainty
    if certainty:
        return M - along @ along.T / known
    # the pseudo-inverse of a scalar; b'M b is rounding where M is blind to b, judged by the size it would have without
    size = ca.sumsqr(b * ca.sqrt(ca.fmax(ca.diag(M), 0)))
    seen = known > _UNSEEN * size
    return M - along @ along.T * ca.if_else(seen, 1 / ca.if_else(seen, known, 1), 0)
