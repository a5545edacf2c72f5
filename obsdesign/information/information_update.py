"""What a step does to information about the state: graphs that the posterior, its use in a design, and its tests share."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.dynamics.process_noise import ProcessNoise
from obsdesign.errors import InputError
from obsdesign.information.householder import solve, triangular_factor
from obsdesign.information.input_exchange import deflate, exchange_inputs, largest_entry

_EPS = float(np.finfo(float).eps)
_RESIDUE = 16 * _EPS  # share of what was added up below which what is left is rounding
_RESIDUE_SCALE = 2.0**-5  # a difference of 8 to 16 eps of A does not change A when it is so much smaller
_NOISE_SHARE = 0.01  # of the rounding of a step that noise leaves: 1e-10 of a column where noise takes all but 1e-8 of it
_SIGNIFICANCE = 1e3  # how many times the rounding of one step a number must have for an unknown input to be seen in it


@dataclass(frozen=True)
class Disturbance:
    """What moves the state beside its inputs: columns of unknown inputs (indices), and noise."""

    unknown: tuple[int, ...]
    noise: ProcessNoise


@dataclass(frozen=True, eq=False)
class InformationRoot:
    """T (m, n), T'T the information; rounding (n, 1): what rounding of one step may have left in each column of T.

    Without it, what is left of a column after an unknown input has taken it could not be told from knowledge.
    error (r, n), r = 0 or 1: what rounding has done to a row of T until now, to first order, with signs as if drawn; see `error_shares`.
    """

    T: ca.SX
    rounding: ca.SX
    error: ca.SX

    def scale(self, unit: ca.SX) -> InformationRoot:
        """Return the root about y where this one is about x = unit y, unit (n, 1) > 0."""
        return InformationRoot(self.T @ ca.diag(unit), unit * self.rounding, self.error @ ca.diag(unit))

    def transform(self, X: ca.SX, magnitudes: ca.SX | None = None) -> InformationRoot:
        """Return the root about y where this one is about X y; magnitudes (m, n) of what was added up in each entry of X, None = of X."""
        magnitudes = ca.fabs(X) if magnitudes is None else magnitudes
        rounding = _EPS * (magnitudes.T @ ca.sum1(ca.fabs(self.T)).T)
        return InformationRoot(self.T @ X, rounding, self.error @ X).add_error(rounding.T)

    def add_error(self, sizes: ca.SX) -> InformationRoot:
        """Return the root with so much more rounding (1, n) in its columns, if that is followed."""
        return InformationRoot(self.T, self.rounding, self.error + _draws(sizes.numel()) * sizes if self.error.shape[0] else self.error)

    def add_solution_error(self, A: ca.SX, inverse: ca.SX) -> InformationRoot:
        """Return the root with what it is off by when it was multiplied by rows of the inverse of A, solved with rounding.

        That is the inverse of A + dA, |dA_ij| <= eps r_i c_j, with r_i the largest of a row, c_j of a column of rows over r_i: T is off
        by T dA A^-1.
        """
        solved, n = [i for i in range(A.shape[0]) if A[i, :].nnz() > 1], A.shape[0]  # the other rows are only divided by
        if not self.error.shape[0] or not solved:
            return self
        sizes = ca.fabs(ca.densify(A))
        rows = [ca.mmax(sizes[i, :]) for i in solved]
        scaled = [sizes[i, :] / ca.if_else(row > 0, row, 1) for i, row in zip(solved, rows, strict=True)]
        columns = ca.horzcat(*[ca.mmax(ca.vertcat(*[row[j] for row in scaled])) for j in range(n)])
        size = _EPS * (ca.sum1(ca.fabs(self.T))[:, solved] @ ca.vertcat(*rows))
        return InformationRoot(self.T, self.rounding, self.error + size * ((_draws(n) * columns) @ inverse))

    def add_noise(self, noise: ca.SX) -> InformationRoot:
        """Return the root once noise, columns of it (m, r) with N(0, 1) each, has been added to what this one is about."""
        T, error = self.T, self.error
        for column in range(noise.shape[1]):
            T, gain, _ = move_along(T, noise[:, column])
            error = error - (error @ noise[:, column]) @ gain
        root = InformationRoot(T, self.rounding, error)
        return root.add_error(_NOISE_SHARE * self.rounding.T) if noise.shape[1] else root

    def with_rows(self, rows: ca.SX) -> InformationRoot:
        """Return the upper triangular root of what both know."""
        rounding = self.rounding + _EPS * ca.sum1(ca.fabs(rows)).T
        return InformationRoot(triangular_factor(ca.vertcat(self.T, rows)), rounding, self.error)

    def without_residues(self) -> InformationRoot:
        """Return the root with 0 for entries that are rounding of their columns: a step that enlarges them would make knowledge of them."""
        sizes = ca.sum1(ca.fabs(self.T))
        threshold = ca.repmat(_RESIDUE * sizes, self.T.shape[0], 1)
        return InformationRoot((ca.fabs(self.T) > threshold) * self.T, self.rounding, self.error).add_error(_EPS * sizes)

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
        factor = is_seen / ca.if_else(is_seen, norm * (norm + ca.fabs(pivot)), 1)
        T = _difference(self.T, (factor * v) @ (v.T @ self.T))
        error = self.error
        if error.shape[0]:
            error = error - (is_seen * (error @ q) / ca.if_else(is_seen, precision, 1)) * (g.T @ self.T)
        return InformationRoot(ca.diag(1 - is_seen * largest) @ T, self.rounding, error)

    def error_about_last(self, n: int) -> ca.SX:
        """Return the error (r, n) of what is known of the last n whatever the others are; T upper triangular, and regular in the others."""
        error = self.error
        for i in range(self.T.shape[1] - n):
            error = error - (error[:, i] / self.T[i, i]) @ self.T[i, :]
        return error[:, self.T.shape[1] - n :]

    def precision_along(self, q: ca.SX) -> ca.SX:
        """Return |T q|^2, 0 where it may be rounding."""
        size, threshold = ca.sumsqr(self.T @ q), _SIGNIFICANCE * ca.dot(self.rounding, ca.fabs(q))
        return (size > threshold * threshold) * size


def move_along(T: ca.SX, b: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return the root of T'(I + g g')^-1 T, g = T b: what is known of x + b e, e ~ N(0, 1); and e given that, gain and deviation.

    gain (1, n) = g'T / (1 + g'g), deviation = (1 + g'g)^-1/2. Givens's rotations of the row (1, 0) of e with each row (g_i, T_i), from
    the last to the first, which keeps T triangular. A row of which noise takes all but a share is multiplied by that share; as a
    difference of what it was and what is taken, it would be rounding (a state that forgets most of itself in a step: F is small, T F^-1
    large).
    """
    g, rows, size, row_of_e = T @ b, ca.vertsplit(T), ca.SX(1), ca.SX(1, T.shape[1])
    for i in reversed(range(T.shape[0])):
        if not g[i].is_zero():
            longer = ca.hypot(size, g[i])
            cosine, sine = size / longer, g[i] / longer
            rows[i], row_of_e, size = cosine * rows[i] - sine * row_of_e, cosine * row_of_e + sine * rows[i], longer
    return ca.vertcat(*rows), row_of_e / size, 1 / size


def _draws(count: int) -> ca.SX:
    """Return (1, count) numbers between 0.7 and 1.3 in size, with signs as if drawn."""
    places = np.arange(1.0, count + 1)
    return ca.SX(ca.DM((np.sign(np.cos(places**2)) * (1 + 0.3 * np.sin(places)))[None]))


def _difference(A: ca.SX, B: ca.SX) -> ca.SX:
    """A - B, 0 where what is left of an entry is rounding."""
    difference = A - B
    return (A + _RESIDUE_SCALE * difference != A) * difference


def predict(root: InformationRoot, F: ca.SX, B: ca.SX, noise: ca.SX, unit: ca.SX) -> InformationRoot:
    """Return the root about x_k+1 = F x_k + B w + noise e where this one is about x_k: of M - M B (B'M B + Q^-1)^# B'M with M = T'T.

    B (n, p) holds the columns of the unknown inputs, for which Q^-1 = 0, noise (n, r) those for which it is I; unit (n, 1): a size of
    each state.
    """
    if not B.shape[1]:
        return root.transform(inverse_step(F)).add_noise(noise)
    root = root.scale(unit).without_residues()
    exchange = exchange_inputs(*in_units(F, B, unit), root.rounding)
    for column in range(exchange.Q.shape[1]):
        root = root.eliminate(exchange.Q[:, column])
    root = root.transform(exchange.X, exchange.magnitudes).add_solution_error(exchange.A, exchange.inverse)
    return root.scale(1 / unit).add_noise(noise)


def inverse_step(F: ca.SX) -> ca.SX:
    """Return F^-1 of a step; raise InputError where a step leaves nothing of some state that a double can hold."""
    n, rank = F.shape[0], ca.sprank(F)
    if rank < n:
        raise InputError(
            f"a step leaves {rank} of {n} states: what decays by more than e^-745 in a step is forgotten within it;"
            " must be a shorter step, or a system without that state"
        )
    return solve(F, ca.SX.eye(n))


def in_units(F: ca.SX, B: ca.SX, unit: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return F and B of the states counted in units (n, 1)."""
    return ca.diag(1 / unit) @ F @ ca.diag(unit), ca.diag(1 / unit) @ B


def predict_back(root: InformationRoot, F: ca.SX, B: ca.SX) -> InformationRoot:
    """Return the root about x_k where this one is about x_k+1 = F x_k + B w, w anything."""
    for column in range(B.shape[1]):
        root = root.eliminate(B[:, column])
    return root.transform(deflate(F, B, root.rounding))
