"""What a step does to information about the state: graphs that the posterior, its use in a design, and its tests share."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.information.householder import triangular_factor
from obsdesign.information.input_exchange import deflate, exchange_inputs, largest_entry

_EPS = float(np.finfo(float).eps)
_RESIDUE = 16 * _EPS  # share of what was added up below which what is left is rounding
_SIGNIFICANCE = 1e3  # how many times the rounding of one step a number must have for an unknown input to be seen in it


@dataclass(frozen=True)
class Disturbance:
    """What moves the state beside its inputs: columns of unknown inputs (indices), and L (n, r), L L' = psd * step, as rows."""

    unknown: tuple[int, ...]
    noise: tuple[tuple[float, ...], ...]

    @property
    def L(self) -> np.ndarray:
        """L (n, r)."""
        return np.array(self.noise)


@dataclass(frozen=True, eq=False)
class InformationRoot:
    """T (m, n), T'T the information; rounding (n, 1): what rounding of one step may have left in each column of T.

    Without it, what is left of a column after an unknown input has taken it could not be told from knowledge.
    """

    T: ca.SX
    rounding: ca.SX

    def scale(self, unit: ca.SX) -> InformationRoot:
        """Return the root about y where this one is about x = unit y, unit (n, 1) > 0."""
        return InformationRoot(self.T @ ca.diag(unit), unit * self.rounding)

    def transform(self, X: ca.SX, magnitudes: ca.SX | None = None) -> InformationRoot:
        """Return the root about y where this one is about X y; magnitudes (m, n) of what was added up in each entry of X, None = of X."""
        magnitudes = ca.fabs(X) if magnitudes is None else magnitudes
        return InformationRoot(self.T @ X, _EPS * (magnitudes.T @ ca.sum1(ca.fabs(self.T)).T))

    def add_noise(self, noise: ca.SX) -> InformationRoot:
        """Return the root once noise, columns of it (m, r) with N(0, 1) each, has been added to what this one is about."""
        T = self.T
        for column in range(noise.shape[1]):
            g = T @ noise[:, column]
            norm = ca.sqrt(1 + ca.sumsqr(g))
            T = T - g @ (g.T @ T) / (norm * (norm + 1))  # (I + g g')^(-1/2) T
        return InformationRoot(T, self.rounding)

    def with_rows(self, rows: ca.SX) -> InformationRoot:
        """Return the upper triangular root of what both know."""
        rounding = self.rounding + _EPS * ca.sum1(ca.fabs(rows)).T
        return InformationRoot(triangular_factor(ca.vertcat(self.T, rows)), rounding)

    def without_residues(self) -> InformationRoot:
        """Return the root with 0 for entries that are rounding of their columns: a step that enlarges them would make knowledge of them."""
        threshold = ca.repmat(_RESIDUE * ca.sum1(ca.fabs(self.T)), self.T.shape[0], 1)
        return InformationRoot(ca.if_else(ca.fabs(self.T) > threshold, self.T, 0), self.rounding)

    def eliminate(self, q: ca.SX) -> InformationRoot:
        """Return the root of what is known whatever t is, where this one is about x + q t, with q (n, 1).

        Householder's reflection turns g = T q into its largest entry; that row alone tells of t, and is left out. An entry that is
        not the largest would leave rows that are the difference of larger ones. T itself where it does not notice t.
        """
        g, precision = self.T @ q, self.precision_along(q)
        is_seen, norm = precision > 0, ca.sqrt(precision)
        largest = largest_entry(ca.fabs(g))
        pivot = ca.dot(largest, g)
        v = g + ca.if_else(pivot >= 0, norm, -norm) * largest
        factor = ca.if_else(is_seen, 1 / ca.if_else(is_seen, norm * (norm + ca.fabs(pivot)), 1), 0)
        T = _difference(self.T, (factor * v) @ (v.T @ self.T))
        return InformationRoot(ca.diag(1 - ca.if_else(is_seen, largest, 0)) @ T, self.rounding)

    def precision_along(self, q: ca.SX) -> ca.SX:
        """Return |T q|^2, 0 where it may be rounding."""
        size, threshold = ca.sumsqr(self.T @ q), _SIGNIFICANCE * ca.dot(self.rounding, ca.fabs(q))
        return ca.if_else(size > threshold * threshold, size, 0)


def _difference(A: ca.SX, B: ca.SX) -> ca.SX:
    """A - B, 0 where what is left of an entry is rounding."""
    difference = A - B
    return ca.if_else(ca.fabs(difference) > _RESIDUE * ca.fabs(A), difference, 0)


def predict(
    root: InformationRoot, F: ca.SX, B_w: ca.SX, disturbance: Disturbance, unit: ca.SX, scale: ca.SX | float = 1.0
) -> InformationRoot:
    """Return the root about x_k+1 = F x_k + B_w w + L noise where this one is about x_k: of M - M B (B'M B + Q^-1)^# B'M with M = T'T.

    B holds the columns of the unknown inputs, for which Q^-1 = 0, and L, for which it is I; unit (n, 1): a size of each
    state; scale: a factor on L.
    """
    noise = scale * ca.sparsify(ca.SX(ca.DM(disturbance.L)))
    if not disturbance.unknown:
        return root.transform(ca.solve(F, ca.SX.eye(F.shape[0]))).add_noise(noise)
    root = root.scale(unit).without_residues()
    exchange = exchange_inputs(*in_units(F, B_w[:, list(disturbance.unknown)], unit), root.rounding)
    for column in range(exchange.Q.shape[1]):
        root = root.eliminate(exchange.Q[:, column])
    return root.transform(exchange.X, exchange.magnitudes).scale(1 / unit).add_noise(noise)


def in_units(F: ca.SX, B: ca.SX, unit: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return F and B of the states counted in units (n, 1)."""
    return ca.diag(1 / unit) @ F @ ca.diag(unit), ca.diag(1 / unit) @ B


def predict_back(root: InformationRoot, F: ca.SX, B: ca.SX) -> InformationRoot:
    """Return the root about x_k where this one is about x_k+1 = F x_k + B w, w anything."""
    for column in range(B.shape[1]):
        root = root.eliminate(B[:, column])
    return root.transform(deflate(F, B, root.rounding))
