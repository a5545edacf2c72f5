"""How likely a log is for given parameters: innovations of a filter, of many values of the parameters side by side."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from obsdesign.calibration.parameters import Parameter, Quantity, Values
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.per_step import PerStepSystem
from obsdesign.dynamics.process_noise import noise_of
from obsdesign.dynamics.simulation import substeps_needed
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.prior import Prior

_DIFFERENCE = 1e-4  # of z


@dataclass(frozen=True, eq=False)
class FilterRows:
    """A log as steps of a filter: rows (dt, dt u) (N, 1 + m), outputs y (N, q), how often each counts (N, q), 0 where there is none."""

    rows: np.ndarray
    y: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True, eq=False)
class LogLikelihood:
    """-log p of a recording for the parameters that are free, fixed ones being what they are; z ~ N(0, 1) beforehand.

    f(z) = 1/2 sum_k (log S_k + e_k^2 / S_k) + 1/2 z'z, e_k the innovation of one output after the other and S_k its variance.
    """

    system: AbstractSystem
    recording: FilterRows
    prior: Prior
    free: tuple[Parameter, ...]
    fixed: Values

    def at(self, z: np.ndarray) -> LikelihoodPoint:
        """Return the value at z (P,), its slope, and Fisher's information: from runs at z and beside it in each direction."""
        points = np.vstack([z, z + _DIFFERENCE * np.eye(len(z))])
        e, S, is_there = self._innovations(points)
        de, dS = ((values[1:] - values[:1]) / _DIFFERENCE for values in (e, S))
        de, dS, e0, S0 = (values[..., is_there] for values in (de, dS, e[0], S[0]))
        slope = de @ (e0 / S0) + dS @ (0.5 / S0 - 0.5 * e0**2 / S0**2) + z
        information = (de / S0) @ de.T + 0.5 * (dS / S0**2) @ dS.T + np.eye(len(z))
        return LikelihoodPoint(float(0.5 * np.sum(np.log(S0) + e0**2 / S0) + 0.5 * z @ z), slope, information)

    def values_at(self, points: np.ndarray) -> np.ndarray:
        """Return f (R,) at points (R, P)."""
        e, S, is_there = self._innovations(points)
        e, S = e[:, is_there], S[:, is_there]
        return 0.5 * np.sum(np.log(S) + e**2 / S, axis=1) + 0.5 * np.sum(points**2, axis=1)

    def innovations_at(self, z: np.ndarray) -> np.ndarray:
        """Return e_k / S_k^1/2 (N, q) at z, nan where there is no sample."""
        e, S, is_there = self._innovations(z[None])
        return np.where(is_there, e[0] / np.sqrt(S[0]), np.nan)

    def without_outliers(self, z: np.ndarray, limit: float) -> LogLikelihood:
        """Return the likelihood of the samples whose innovation is within so many of its standard deviations at z."""
        is_outlier = np.abs(np.nan_to_num(self.innovations_at(z))) > limit
        return replace(self, recording=replace(self.recording, weights=np.where(is_outlier, 0.0, self.recording.weights)))

    def _innovations(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return e and S (R, N, q) in the units of the outputs, and where there are any (N, q)."""
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
        e, S = self._bank.sequential_innovations(self._start(len(points)), u, y, weights, noises)
        return e * scale[:, None], S * scale[:, None] ** 2, rows.weights > 0

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
