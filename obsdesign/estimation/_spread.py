"""How sure a belief is, as a graph: a covariance, or a root of one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.information.householder import triangular_factor
from obsdesign.packing import pack, pack_values, symmetric, unpack


class AbstractSpread(ABC):
    """The covariance P (n, n) of a belief's errors, in the form in which a filter carries it."""

    @property
    @abstractmethod
    def column(self) -> ca.SX:
        """What is carried, as a column."""

    @property
    @abstractmethod
    def covariance(self) -> ca.SX:
        """P (n, n)."""

    @abstractmethod
    def cross_covariance(self, rows: ca.SX) -> ca.SX:
        """Return P rows' (n, q)."""

    @abstractmethod
    def after_sample(self, row: ca.SX, variance: ca.SX) -> tuple[ca.SX, AbstractSpread]:
        """Return the gain (n, 1) of a sample row x + noise of a variance >= 0, and what is left of P."""

    @abstractmethod
    def inflate(self, factor: ca.SX | float) -> AbstractSpread:
        """Return factor P."""

    @abstractmethod
    def of_columns(self, columns: ca.SX) -> AbstractSpread:
        """Return A A' of columns A (n, r), in the form of this one."""

    @abstractmethod
    def plus(self, other: AbstractSpread) -> AbstractSpread:
        """Return P + P_other, of the same form."""

    @abstractmethod
    def through(self, F: ca.SX, noise: AbstractSpread) -> AbstractSpread:
        """Return F P F' + noise."""


@dataclass(frozen=True, eq=False)
class CovarianceSpread(AbstractSpread):
    """P itself."""

    P: ca.SX

    @property
    def column(self) -> ca.SX:
        """Its lower triangle."""
        return pack(self.P)

    @property
    def covariance(self) -> ca.SX:
        """P."""
        return self.P

    def cross_covariance(self, rows: ca.SX) -> ca.SX:
        """Return P rows'."""
        return self.P @ rows.T

    def after_sample(self, row: ca.SX, variance: ca.SX) -> tuple[ca.SX, AbstractSpread]:
        """Return K = P c' / (c P c' + R) and (I - K c) P (I - K c)' + K R K'.

        Source: Bucy and Joseph (1968), section 16; the products as columns, the lower triangle alone.
        """
        cross = self.P @ row.T
        gain = cross / _nonzero(row @ cross + variance)
        reduced = _symmetric(self.P - gain @ cross.T)
        return gain, CovarianceSpread(_symmetric(reduced + (variance * gain - reduced @ row.T) @ gain.T))

    def inflate(self, factor: ca.SX | float) -> CovarianceSpread:
        """Return factor P."""
        return CovarianceSpread(factor * self.P)

    def of_columns(self, columns: ca.SX) -> CovarianceSpread:
        """Return A A'."""
        return CovarianceSpread(columns @ columns.T)

    def plus(self, other: AbstractSpread) -> CovarianceSpread:
        """Return P + P_other."""
        return CovarianceSpread(self.P + other.covariance)

    def through(self, F: ca.SX, noise: AbstractSpread) -> CovarianceSpread:
        """Return F P F' + Q."""
        return CovarianceSpread(_symmetric(F @ self.P @ F.T + noise.covariance))


@dataclass(frozen=True, eq=False)
class RootSpread(AbstractSpread):
    """S (n, n), S S' = P: what it loses to rounding is a share of a standard deviation, where P loses one of a variance."""

    S: ca.SX

    @property
    def column(self) -> ca.SX:
        """S by columns."""
        return ca.vec(ca.densify(self.S))

    @property
    def covariance(self) -> ca.SX:
        """S S'."""
        return self.S @ self.S.T

    def cross_covariance(self, rows: ca.SX) -> ca.SX:
        """Return S (rows S)'."""
        return self.S @ (rows @ self.S).T

    def after_sample(self, row: ca.SX, variance: ca.SX) -> tuple[ca.SX, AbstractSpread]:
        """Return S f / v and S - S f f' / (v + (R v)^1/2), f = S'c', v = f'f + R.

        Source: Potter (1963), in Bierman (1977), section II.7.
        """
        f = self.S.T @ row.T
        v, cross = ca.sumsqr(f) + variance, self.S @ f
        return cross / _nonzero(v), RootSpread(self.S - cross @ f.T / _nonzero(v + ca.sqrt(variance * v)))

    def inflate(self, factor: ca.SX | float) -> RootSpread:
        """Return factor^1/2 S."""
        return RootSpread(ca.sqrt(factor) * self.S)

    def of_columns(self, columns: ca.SX) -> RootSpread:
        """Return A, which need not be square."""
        return RootSpread(columns)

    def plus(self, other: AbstractSpread) -> RootSpread:
        """Return both roots side by side."""
        return RootSpread(ca.horzcat(self.S, root_graph(other)))

    def through(self, F: ca.SX, noise: AbstractSpread) -> RootSpread:
        """Return the triangular root of F S S' F' + Q."""
        return root_of_columns(F @ self.S, root_graph(noise))


def root_of_columns(*columns: ca.SX) -> RootSpread:
    """Return the lower triangular root of the sum of A A' over matrices A (n, .)."""
    return RootSpread(triangular_factor(ca.horzcat(*columns).T).T)


def root_graph(spread: AbstractSpread) -> ca.SX:
    """Return S (n, n), of noise (n, r), of a spread that is carried as a root."""
    if not isinstance(spread, RootSpread):
        raise TypeError("a covariance has no root in a graph")
    return spread.S


def spread_symbols(name: str, n: int, has_roots: bool) -> tuple[AbstractSpread, ca.SX]:
    """Return a spread of symbols, and the column in which they stand."""
    if has_roots:
        S = ca.SX.sym(name, n, n)
        return RootSpread(S), ca.vec(S)
    P, entries = symmetric(name, n)
    return CovarianceSpread(P), entries


def spread_values(covariance: np.ndarray, has_roots: bool) -> np.ndarray:
    """Return the columns (..., c) of covariances (..., n, n)."""
    if not has_roots:
        return pack_values(covariance)
    return root_values(covariance).swapaxes(-1, -2).reshape(*covariance.shape[:-2], -1)


def covariance_values(columns: np.ndarray, n: int, has_roots: bool) -> np.ndarray:
    """Return the covariances (..., n, n) of columns (..., c)."""
    if not has_roots:
        return unpack(columns, n)
    S = columns.reshape(*columns.shape[:-1], n, n).swapaxes(-1, -2)
    return S @ S.swapaxes(-1, -2)


def root_values(covariance: np.ndarray) -> np.ndarray:
    """Return S (..., n, n), S S' = covariance, positive semidefinite, each state in its own unit."""
    size = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    unit = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / (unit[..., :, None] * unit[..., None, :]))
    return unit[..., :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]


def _symmetric(P: ca.SX) -> ca.SX:
    """P of its lower triangle alone."""
    return ca.tril2symm(ca.tril(P))


def _nonzero(value: ca.SX) -> ca.SX:
    """The value, 1 where it is 0: what it divides is 0 then."""
    return ca.if_else(value > 0, value, 1)
