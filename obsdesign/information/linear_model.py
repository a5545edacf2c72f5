"""Errors of a state along a path as one linear model: what a Kalman filter that knows how samples err would work with."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import get_lapack_funcs

from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.nuisance_states import NuisanceStates, nuisance_of
from obsdesign.errors import InputError
from obsdesign.information.information_update import Disturbance
from obsdesign.information.linearisation import linearise
from obsdesign.information.sample_information import require_derivatives
from obsdesign.prior import Prior
from obsdesign.round_off import rotated_triangles
from obsdesign.trajectory import Trajectory

_WHITE_SHARE = 1e-6  # of coloured errors: the share of their covariance that counts as white, so that covariances stay regular


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Errors z = (x, b, e) of state, constant and coloured errors: z_k+1 = A_k z_k + w_k, samples r_ki z_k + v_ki, v_ki ~ N(0, 1).

    initial_covariance (n, n) before the samples at t_0; transition A_k and noise Q_k (N-1, n, n) from t_k to t_k+1; rows r_ki
    (N, q, n) over the standard deviation of what is white, 0 where there is no sample; sensor_of_row (q,). unknown_columns
    (N-1, n, p): what the unknown inputs named move, which is not in Q. spreads (N, q): the standard deviations of samples, in the
    units of the outputs.

    A coloured error e of covariance R is taken as e' + v with e' of covariance (1 - c) R and v white of variance
    c l / (1 + d)^2, l the smallest eigenvalue of what drives e, d its largest decay: the spectrum of e is nowhere below
    l / (1 + d)^2, so all samples together err no more than in truth, and by at least 1 - c of it. Covariances computed from it lie
    below the true ones, by at most that share.
    """

    initial_covariance: np.ndarray
    transition: np.ndarray
    noise: np.ndarray
    rows: np.ndarray
    sensor_of_row: np.ndarray
    unknown_columns: np.ndarray
    spreads: np.ndarray

    def with_floors(self, floors: np.ndarray, nodes: np.ndarray) -> LinearModel:
        """Return the model in which the mean error of a sensor within a segment between nodes (K+1,) never falls below its floor (S,).

        n samples of standard deviation s with an error b in common tell a state that hardly moves as much as n samples of
        (s^2 + n b^2)^1/2: rows are divided by (1 + n b^2 / s^2)^1/2.
        """
        is_sampled = self.rows.any(axis=2)
        counts = np.repeat(np.add.reduceat(is_sampled, nodes[:-1], axis=0), np.diff(nodes), axis=0)
        ratio = floors[self.sensor_of_row] / self.spreads
        return replace(self, rows=self.rows / np.sqrt(1 + counts * ratio**2)[:, :, None])

    def with_unknown_inputs(self, variance: np.ndarray) -> LinearModel:
        """Return the model in which each unknown input has a variance (p,) in a step in place of an infinite one: one that knows more."""
        B = self.unknown_columns
        return replace(self, noise=self.noise + (B * variance) @ B.swapaxes(1, 2))

    def in_units(self, units: np.ndarray) -> LinearModel:
        """Return the model of z_i / units_i (n,)."""
        square = units[:, None] * units
        return replace(
            self,
            initial_covariance=self.initial_covariance / square,
            transition=self.transition * units / units[:, None],
            noise=self.noise / square,
            rows=self.rows * units,
            unknown_columns=self.unknown_columns / units[:, None],
        )

    def in_order(self, order: np.ndarray) -> LinearModel:
        """Return the model of z_order."""
        square = np.ix_(order, order)
        return replace(
            self,
            initial_covariance=self.initial_covariance[square],
            transition=self.transition[:, *square],
            noise=self.noise[:, *square],
            rows=self.rows[:, :, order],
            unknown_columns=self.unknown_columns[:, order],
        )

    def covariances(self, active: np.ndarray) -> np.ndarray:
        """Return the covariances (..., N, n, n) of z after the samples at t_k of a Kalman filter, active (..., N, S): what is on."""
        P = np.broadcast_to(self.initial_covariance, (*active.shape[:-2], *self.initial_covariance.shape))
        result = np.empty((*active.shape[:-1], *self.initial_covariance.shape))
        is_on = (active[..., self.sensor_of_row] > 0) & self.rows.any(axis=2)
        for k in range(self.steps):
            for i in np.flatnonzero(is_on[..., k, :].reshape(-1, self.rows.shape[1]).any(axis=0)):
                row = self.rows[k, i]
                v = P @ row
                P = P - v[..., :, None] * (v / (1 + v @ row)[..., None] * is_on[..., k, i, None])[..., None, :]
            result[..., k, :, :] = P
            if k < self.steps - 1:
                P = self.transition[k] @ P @ self.transition[k].T + self.noise[k]
                P = (P + P.swapaxes(-1, -2)) / 2
        return result

    def covariance_roots(self, active: np.ndarray) -> np.ndarray:
        """Return roots B (N, n, n), B B' the covariance after the samples at t_k, active (N, S): with twice the digits of B B'.

        Rows of B' after a sample r, from (1, 0; B'r, B'), and after a step, from (A B, Q^1/2)', by rotations: Kailath, Sayed, Hassibi
        (2000), chapter 12.
        """
        n = len(self.initial_covariance)
        R, noise_rows = _rows_of(self.initial_covariance), [_rows_of(Q) for Q in self.noise]
        is_on = (active[:, self.sensor_of_row] > 0) & self.rows.any(axis=2)
        roots = np.empty((self.steps, n, n))
        for k in range(self.steps):
            for row in self.rows[k, is_on[k]]:
                R = rotated_triangles(np.block([[np.ones((1, 1)), np.zeros((1, n))], [(R @ row)[:, None], R]]))[1:, 1:]
            roots[k] = R.T
            if k < self.steps - 1:
                R = rotated_triangles(np.vstack([R @ self.transition[k].T, noise_rows[k]]))
        return roots

    @property
    def steps(self) -> int:
        """N, the number of instants with samples."""
        return len(self.rows)


def linear_model_of(system: AbstractSystem, path: Trajectory, prior: Prior, disturbance: Disturbance, weights: np.ndarray) -> LinearModel:
    """Return the model along a path; disturbance, weights (N, S): as for the posterior.

    Raises InputError for samples that have no derivative.
    """
    model, nuisance, n = system.model, nuisance_of(system.model, path.pace), path.x.shape[1]
    linearisation = linearise(system, path, weights, disturbance.noise)
    N, q, c, a = path.steps, len(model.output_owner), len(nuisance.constant), len(nuisance.coloured)
    B = linearisation.B[:, :, list(disturbance.unknown)]
    size, L = n + c + a, linearisation.noise
    transition, noise, covariance = np.zeros((N, size, size)), np.zeros((N, size, size)), np.zeros((size, size))
    transition[:, :n, :n] = linearisation.F
    transition[:, range(n, size), range(n, size)] = np.hstack([np.ones((N, c)), nuisance.decays(path.paces)])
    noise[:, :n, :n] = L @ L.swapaxes(1, 2)
    noise[:, n + c :, n + c :] = (1 - _WHITE_SHARE) * nuisance.driving_covariances(path.paces)
    covariance[:n, :n], covariance[n : n + c, n : n + c] = prior.covariance, np.eye(c)
    covariance[n + c :, n + c :] = (1 - _WHITE_SHARE) * nuisance.R
    rows = np.zeros((N, q, size))
    rows[:, :, :n], rows[:, :, n : n + c] = linearisation.state_rows, linearisation.bias_loads
    for index, output in enumerate(nuisance.coloured):
        rows[:, output, n + c + index] = 1.0
    rows = _whiten(rows, linearisation.missing + _white_part(nuisance, q), weights[:, list(model.output_owner)])
    if not (np.isfinite(rows).all() and np.isfinite(transition).all()):
        require_derivatives(system, path, weights > 0)
        raise InputError("the linearised model is not finite along the path")
    columns = np.zeros((N - 1, size, B.shape[2]))
    columns[:, :n] = B[:-1]
    return LinearModel(covariance, transition[:-1], noise[:-1], rows, np.array(model.output_owner), columns, linearisation.spreads)


def _rows_of(Q: np.ndarray) -> np.ndarray:
    """Return rows A (n, n), A'A = Q (n, n) >= 0, of the rank that its digits show: Cholesky's, the largest pivots first."""
    size = np.sqrt(np.diagonal(Q))
    unit = np.where(size > 0, size, 1.0)
    (pstrf,) = get_lapack_funcs(("pstrf",), (Q,))
    factor, order, rank, _ = pstrf(Q / unit[:, None] / unit, tol=-1.0)
    rows = np.zeros_like(Q)
    rows[:rank, order - 1] = np.triu(factor)[:rank]
    return rows * unit


def _whiten(rows: np.ndarray, variance: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return rows (N, q, n) over the root of their white variance (N, q), as often as samples count, 0 where there is none."""
    is_sampled = (weights > 0) & (variance < np.inf)
    of_all = np.where(is_sampled, variance, 1.0) / np.where(is_sampled, weights, 1.0)
    return np.where(is_sampled[:, :, None], rows, 0.0) / np.sqrt(of_all)[:, :, None]


def _white_part(nuisance: NuisanceStates, outputs: int) -> np.ndarray:
    """Return the variance (q,) of what counts as white in an error relative to its spread: 1 where all of it is."""
    part = np.ones(outputs)
    if nuisance.coloured:
        one = np.ones(1)
        smallest = float(np.linalg.eigvalsh(nuisance.driving_covariances(one)[0])[0])
        part[list(nuisance.coloured)] = _WHITE_SHARE * smallest / (1 + float(nuisance.decays(one).max())) ** 2
    return part
