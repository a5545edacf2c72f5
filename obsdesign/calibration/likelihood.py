"""How likely a log is for given parameters: innovations of a filter, of many values of the parameters side by side."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from obsdesign.calibration.parameters import Parameter, Quantity, Values
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.per_step import PerStepSystem
from obsdesign.dynamics.process_noise import ProcessNoise, noise_of
from obsdesign.dynamics.simulation import substeps_needed
from obsdesign.estimation.extended_kalman_filter import ExtendedKalmanFilter
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.estimation.gate import Gate
from obsdesign.prior import Prior

_DIFFERENCE = 1e-4  # of z
_FREEDOM = 4.0  # degrees of freedom of Student's t
_STEP = 1e-2  # of z, of the restricted likelihood
_MOST_UPDATES = 2e7  # outputs that all runs of its slant take in: of a longer log what is explained by chance is small
_MOST_LESS = 0.8  # of what samples tell of a size


@dataclass(frozen=True, eq=False)
class FilterRows:
    """A log as steps of a filter: rows (dt, dt u) (N, 1 + m), outputs y (N, q), how often each counts (N, q), 0 where there is none."""

    rows: np.ndarray
    y: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True, eq=False)
class LogLikelihood:
    """-log p of a recording for the parameters that are free, fixed ones being what they are; z ~ N(0, 1) beforehand.

    f(z) = 1/2 sum_k (log S_k + e_k^2 / S_k) + 1/2 z'z, e_k the innovation of one output after the other and S_k its variance;
    has_tails: of Student's t, 1/2 sum_k (log S_k + 5 log(1 + e_k^2 / (4 S_k))), to which no sample matters much however far off it is.
    slant (P,), if any: slant'z is added, see `without_chance`.
    """

    system: AbstractSystem
    recording: FilterRows
    prior: Prior
    free: tuple[Parameter, ...]
    fixed: Values
    has_tails: bool = False
    slant: np.ndarray | None = None

    def at(self, z: np.ndarray) -> LikelihoodPoint:
        """Return the value at z (P,), its slope, and Fisher's information: from runs at z and beside it in each direction."""
        points = np.vstack([z, z + _DIFFERENCE * np.eye(len(z))])
        e, S, is_there = self._innovations(points)
        de, dS = ((values[1:] - values[:1]) / _DIFFERENCE for values in (e, S))
        de, dS, e0, S0 = (values[..., is_there] for values in (de, dS, e[0], S[0]))
        q = e0**2 / S0
        weight, of_mean, of_variance = self._tails(q)
        slope = de @ (weight * e0 / S0) + dS @ (0.5 / S0 - 0.5 * weight * q / S0) + z
        information = of_mean * (de / S0) @ de.T + 0.5 * of_variance * (dS / S0**2) @ dS.T + np.eye(len(z))
        value = float(0.5 * np.sum(np.log(S0) + self._loss(q)) + 0.5 * z @ z)
        return self._with_slant(LikelihoodPoint(value, slope, information), z)

    def values_at(self, points: np.ndarray) -> np.ndarray:
        """Return f (R,) at points (R, P)."""
        e, S, is_there = self._innovations(points)
        e, S = e[:, is_there], S[:, is_there]
        slanted = points @ self.slant if self.slant is not None else 0.0
        return 0.5 * np.sum(np.log(S) + self._loss(e**2 / S), axis=1) + 0.5 * np.sum(points**2, axis=1) + slanted

    def innovations_at(self, z: np.ndarray) -> np.ndarray:
        """Return e_k / S_k^1/2 (N, q) at z, nan where there is no sample."""
        e, S, is_there = self._innovations(z[None])
        return np.where(is_there, e[0] / np.sqrt(S[0]), np.nan)

    def only(self, chosen: np.ndarray) -> LogLikelihood:
        """Return the likelihood of some of the free parameters (P,) bool, the others being as without the data."""
        free = tuple(parameter for parameter, is_free in zip(self.free, chosen, strict=True) if is_free)
        return replace(self, free=free, slant=None if self.slant is None else self.slant[chosen])

    def without_outliers(self, z: np.ndarray, gate: Gate) -> LogLikelihood:
        """Return the likelihood of the samples that a filter with such a gate takes in at z."""
        u, y, weights, noises = self._rows_at(z[None])
        bank = replace(self._bank, noise=noises[0], estimator=ExtendedKalmanFilter(gate=gate))
        runs = (np.broadcast_to(part, (1, *part.shape[-2:])) for part in (y, weights))
        y, weights = (part.swapaxes(0, 1) for part in runs)
        reports = bank.report(self._start(1), u[0] if u.ndim == 3 else u, y, weights)[1]
        is_rejected = (reports.is_usable & ~reports.is_taken)[:, 0]
        return replace(self, recording=replace(self.recording, weights=np.where(is_rejected, 0.0, self.recording.weights)))

    def without_chance(self, z: np.ndarray) -> LogLikelihood:
        """Return the likelihood of sizes with biases and scales integrated out (Patterson and Thompson 1971, Biometrika 58, 545-554).

        That is f + 1/2 log det H, H the information of biases and scales: what they explain of the errors by chance is not taken for
        smaller errors. Near z the logarithm is its tangent, slant'z.
        """
        is_size = np.array([parameter.quantity.is_positive for parameter in self.free], dtype=bool)
        sizes, corrections = np.flatnonzero(is_size), np.flatnonzero(~is_size)
        runs = len(sizes) * (len(corrections) + 1)
        slant = np.zeros(len(z))
        if runs and len(corrections) and runs * self.recording.weights.size <= _MOST_UPDATES:
            start = self._log_det(z, corrections)
            slant[sizes] = [(self._log_det(z + _STEP * unit, corrections) - start) / (2 * _STEP) for unit in np.eye(len(z))[sizes]]
        return replace(self, slant=np.minimum(slant, 0.0))

    def _log_det(self, z: np.ndarray, chosen: np.ndarray) -> float:
        """Return log det of the information of some parameters at z."""
        e, S, is_there = self._innovations(np.vstack([z, z + _DIFFERENCE * np.eye(len(z))[chosen]]))
        de = ((e[1:] - e[:1]) / _DIFFERENCE)[:, is_there]
        return float(np.linalg.slogdet((de / S[0, is_there]) @ de.T + np.eye(len(chosen)))[1])

    def _with_slant(self, point: LikelihoodPoint, z: np.ndarray) -> LikelihoodPoint:
        """Return the point with what the slant adds; of n numbers with p explained by chance, log variance has (n - p) / 2."""
        if self.slant is None:
            return point
        told = point.information - np.eye(len(z))
        of_variance = np.array([p.spread * (1 if p.quantity.may_be_nothing else 2) for p in self.free])  # d log variance / dz
        share = -self.slant * of_variance / np.maximum(np.diag(told), 1e-9)
        root = np.sqrt(1 - np.minimum(share, _MOST_LESS))
        information = told * root * root[:, None] + np.eye(len(z))
        return LikelihoodPoint(point.value + float(self.slant @ z), point.slope + self.slant, information)

    def _loss(self, q: np.ndarray) -> np.ndarray:
        """Return -2 log p of e at q = e^2 / S, but for log S."""
        return (_FREEDOM + 1) * np.log1p(q / _FREEDOM) if self.has_tails else q

    def _tails(self, q: np.ndarray) -> tuple[np.ndarray | float, float, float]:
        """Return by what a sample at q counts in the slope, and by what information of means and of variances counts.

        Of Student's t with nu degrees of freedom (nu + 1) / (nu + q), (nu + 1) / (nu + 3) and nu / (nu + 3).
        """
        nu = _FREEDOM
        return ((nu + 1) / (nu + q), (nu + 1) / (nu + 3), nu / (nu + 3)) if self.has_tails else (1.0, 1.0, 1.0)

    def _innovations(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return e and S (R, N, q) in the units of the outputs, and where there are any (N, q)."""
        scale = self._values(points).over(Quantity.SCALE, self.recording.y.shape[1], 1.0)
        e, S = self._bank.sequential_innovations(self._start(len(points)), *self._rows_at(points))
        return e * scale[:, None], S * scale[:, None] ** 2, self.recording.weights > 0

    def _rows_at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[ProcessNoise]]:
        """Return inputs, outputs and weights of a filter of the stated system, (N, .) or (R, N, .), and the process noise of R runs."""
        values, rows = self._values(points), self.recording
        q, m = rows.y.shape[1], rows.rows.shape[1] - 1
        bias, scale = values.over(Quantity.BIAS, q, 0.0), values.over(Quantity.SCALE, q, 1.0)
        size = values.over(Quantity.SIGMA, q, 1.0) * values.over(Quantity.INFLATION, q, 1.0)
        y, weights, u = rows.y, rows.weights, rows.rows
        if values.has(Quantity.BIAS, Quantity.SCALE):
            y = (y - bias[:, None]) / scale[:, None]
        if values.has(Quantity.SCALE, Quantity.SIGMA, Quantity.INFLATION):
            weights = weights * (scale / size)[:, None] ** 2
        if values.has(Quantity.INPUT_BIAS, Quantity.INPUT_SCALE):
            input_bias, input_scale = values.over(Quantity.INPUT_BIAS, m, 0.0), values.over(Quantity.INPUT_SCALE, m, 1.0)
            dt, integrals = u[:, :1], u[:, 1:]
            moved = (integrals - input_bias[:, None] * dt) / input_scale[:, None]
            u = np.concatenate([np.broadcast_to(dt, (*moved.shape[:-1], 1)), moved], axis=-1)
        noises = [noise_of(self.system.model, *self._psds(values, run), 1.0) for run in range(len(points))]
        return u, y, weights, noises

    def _values(self, points: np.ndarray) -> Values:
        free = np.empty(points.shape)
        for i, parameter in enumerate(self.free):
            free[:, i] = parameter.value(points[:, i])
        fixed = np.broadcast_to(self.fixed.values, (len(points), len(self.fixed.parameters)))
        return Values((*self.free, *self.fixed.parameters), np.concatenate([free, fixed], axis=1))

    def _psds(self, values: Values, run: int) -> tuple[np.ndarray, dict[str, float]]:
        return Values(values.parameters, values.values[run]).psds(self.system.model)

    def _start(self, runs: int) -> Belief:
        return Belief(np.tile(self.prior.mean, (runs, 1)), np.tile(self.prior.covariance, (runs, 1, 1)))

    @cached_property
    def _bank(self) -> FilterBank:
        """All runs of one length, with as many sub-steps as the log asks for."""
        along = PerStepSystem(self.system, has_arrived=True)
        substeps = int(substeps_needed(along, self.prior.mean[None], self.recording.rows, 1.0).max(initial=1))
        n = len(self.system.model.states)
        return FilterBank(along, 1.0, np.zeros((n, n)), substeps)


@dataclass(frozen=True, eq=False)
class LikelihoodPoint:
    """f, its slope (P,), and Fisher's information (P, P) at some z."""

    value: float
    slope: np.ndarray
    information: np.ndarray

    @property
    def decrement(self) -> float:
        """By how much f is expected to fall in the best step."""
        return float(0.5 * self.slope @ np.linalg.solve(self.information, self.slope))
