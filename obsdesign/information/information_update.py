"""What a step does to information about the state: graphs that the posterior, its use in a design, and its tests share."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

_EPS = float(np.finfo(float).eps)
_ROUNDING_MEMORY = 0.1  # how much of the rounding of one step counts in the next: unknown inputs wipe it out as well
_SIGNIFICANCE = 1e3  # how many times the bound on its rounding a number must have to mean anything


@dataclass(frozen=True)
class Disturbance:
    """What moves the state beside its inputs: columns of unknown inputs (indices), and L (n, r), L L' = psd * step, as rows."""

    unknown: tuple[int, ...]
    noise: tuple[tuple[float, ...], ...]

    @property
    def L(self) -> np.ndarray:
        """L (n, r)."""
        return np.array(self.noise)


def triangular_factor(rows: ca.SX) -> ca.SX:
    """Return upper triangular R (n, n) with R'R = A'A for rows A (m, n), m >= n, by Householder's reflections."""
    m, n = rows.shape
    A = [[rows[i, j] for j in range(n)] for i in range(m)]
    for j in range(n):
        below = [i for i in range(j, m) if not A[i][j].is_zero()]
        if below and below != [j]:
            _reflect(A, sorted({j, *below}), j)
    return ca.vertcat(*[ca.horzcat(*[A[i][j] if j >= i else ca.SX(1, 1) for j in range(n)]) for i in range(n)])


def _reflect(A: list[list[ca.SX]], rows: list[int], column: int) -> None:
    """Turn the given rows so that only the first of them has an entry in the column; in place."""
    x = [A[i][column] for i in rows]
    size = ca.sumsqr(ca.vertcat(*x))
    is_nonzero = size != 0  # true for nan, which must not be lost
    norm = ca.if_else(is_nonzero, ca.sqrt(ca.if_else(is_nonzero, size, 1)), 0)
    signed = ca.if_else(x[0] >= 0, norm, -norm)
    v = [x[0] + signed, *x[1:]]
    factor = ca.if_else(is_nonzero, 1 / ca.if_else(is_nonzero, norm * (norm + ca.fabs(x[0])), 1), 0)
    for j in range(column + 1, len(A[0])):
        if all(A[i][j].is_zero() for i in rows):
            continue
        projection = factor * sum((v[k] * A[i][j] for k, i in enumerate(rows)), ca.SX(0))
        for k, i in enumerate(rows):
            A[i][j] -= projection * v[k]
    A[rows[0]][column] = -signed
    for i in rows[1:]:
        A[i][column] = ca.SX(0)


@dataclass(frozen=True, eq=False)
class InformationRoot:
    """T (m, n), T'T the information; rounding (n, 1): what rounding may have left in each column of T, of late.

    Without it, what is left of a column after an unknown input has taken it could not be told from knowledge.
    """

    T: ca.SX
    rounding: ca.SX

    def transform(self, F: ca.SX) -> InformationRoot:
        """Return the root about y where this one is about F y."""
        return InformationRoot(self.T @ F, ca.fabs(F).T @ (_ROUNDING_MEMORY * self.rounding + _round_off(self.T)))

    def add_noise(self, noise: ca.SX) -> InformationRoot:
        """Return the root once noise, columns of it (m, r) with N(0, 1) each, has been added to what this one is about."""
        T = self.T
        for column in range(noise.shape[1]):
            g = T @ noise[:, column]
            norm = ca.sqrt(1 + ca.sumsqr(g))
            T = T - g @ (g.T @ T) / (norm * (norm + 1))
        return InformationRoot(T, self.next_rounding)

    @property
    def next_rounding(self) -> ca.SX:
        """Rounding (n, 1) once T has been computed with again."""
        return self.rounding + _round_off(self.T)

    def with_rows(self, rows: ca.SX) -> InformationRoot:
        """Return the upper triangular root of what both know."""
        return InformationRoot(triangular_factor(ca.vertcat(self.T, rows)), self.rounding + _round_off(rows))


def _round_off(T: ca.SX) -> ca.SX:
    """Rounding (n, 1) of sums of the entries of each column."""
    return _EPS * ca.sum1(ca.fabs(T)).T


def add_disturbance(root: InformationRoot, B_w: ca.SX, disturbance: Disturbance) -> InformationRoot:
    """Return the root of M - M B (B'M B + Q^-1)^# B'M with M = T'T, one column of B after the other.

    B holds the columns of the unknown inputs, for which Q^-1 = 0, and L, for which it is I. Roots keep what squares lose: where
    nothing is known any more, what is left is the square of rounding.
    """
    T, rounding = root.T, root.next_rounding
    for column in disturbance.unknown:
        T = _project_out(T, B_w[:, column], rounding)
    for column in 2 * disturbance.unknown:  # twice: one may undo a little of the other
        T = restore_null_direction(T, B_w[:, column], rounding)
    L = ca.sparsify(ca.SX(ca.DM(disturbance.L)))
    for column in range(L.shape[1]):
        g = T @ L[:, column]
        norm = ca.sqrt(1 + ca.sumsqr(g))
        T = T - g @ (g.T @ T) / (norm * (norm + 1))  # (I + g g')^(-1/2) T
    return InformationRoot(T, rounding)


def _project_out(T: ca.SX, b: ca.SX, rounding: ca.SX) -> ca.SX:
    """(I - g g' / g'g) T with g = T b: what rows say whatever moves along b; T itself where they do not notice."""
    g = T @ b
    return T - conditional_variance(g, b, rounding) * (g @ (g.T @ T))


def conditional_variance(g: ca.SX, b: ca.SX, rounding: ca.SX) -> ca.SX:
    """Return 1 / g'g, g = T b: the variance of what moves the state along b, given where it came to; 0 where T does not notice."""
    threshold = _SIGNIFICANCE * (rounding.T @ ca.fabs(b))
    size = ca.sumsqr(g)
    is_visible = size > threshold * threshold
    return ca.if_else(is_visible, 1 / ca.if_else(is_visible, size, 1), 0)


def restore_null_direction(T: ca.SX, b: ca.SX, rounding: ca.SX) -> ca.SX:
    """T with T b = 0 restored, which was so but for rounding: else that would grow from step to step. Changes columns by their rounding."""
    weights = rounding * rounding * b
    size = b.T @ weights
    is_nonzero = size > 0
    return T - ca.if_else(is_nonzero, 1 / ca.if_else(is_nonzero, size, 1), 0) * ((T @ b) @ weights.T)
