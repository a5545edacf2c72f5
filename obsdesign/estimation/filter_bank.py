"""Filters of many runs side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from obsdesign.checks import all_finite
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.nuisance_states import NuisanceStates, nuisance_of
from obsdesign.dynamics.process_noise import ProcessNoise
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import require_free_outputs, substeps_needed
from obsdesign.errors import InputError
from obsdesign.estimation._filter_scans import (
    FilterKey,
    filter_scan,
    innovation_scan,
    predict_scan,
    report_scan,
    smoother_scan,
    update_scan,
)
from obsdesign.estimation._noise import NoiseForm, form_of, noise_row
from obsdesign.estimation._spread import covariance_values, root_values, spread_values
from obsdesign.estimation.abstract import AbstractEstimator
from obsdesign.estimation.extended_kalman_filter import ExtendedKalmanFilter
from obsdesign.estimation.gate import counter_values
from obsdesign.trajectory import TOLERANCE


@dataclass(frozen=True, eq=False)
class Belief:
    """What the filters of R runs believe: mean (..., R, n), covariance (..., R, n, n).

    carry (R, .): the same with the nuisance states of samples whose errors last and the counters of the gate, as the next step takes
    it; None: nothing has been learned of them yet.
    """

    mean: np.ndarray
    covariance: np.ndarray
    carry: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class SampleReports:
    """What became of the samples of R runs, (N, R, ...), q outputs and S sensors.

    residual (q,) and the variance (q,) that is expected of it; nis (S,) the normalised squares; is_usable (q,): there, and with
    a finite expectation; is_taken (q,): taken in; is_alarm (S,): the gate found the filter wrong, and inflated its covariance.
    """

    residual: np.ndarray
    variance: np.ndarray
    nis: np.ndarray
    is_usable: np.ndarray
    is_taken: np.ndarray
    is_alarm: np.ndarray


@dataclass(frozen=True, eq=False)
class FilterBank:
    """Predict and update filters of one system side by side; noise: process noise of one step of `step` seconds, or its covariance (n, n).

    The filter's own model of the samples is the one that is stated: correlated, constant and joint errors are nuisance states
    beside x, see `NuisanceStates`. A sample has then nothing white left, and covariances are carried as roots.
    substeps: of how many each step is made; None: as many as `tolerance` asks for along the motion of the means without samples.
    """

    system: AbstractSystem
    step: float
    noise: np.ndarray | ProcessNoise
    substeps: int | None = None
    tolerance: float = TOLERANCE
    estimator: AbstractEstimator = field(default_factory=ExtendedKalmanFilter)

    def predict(self, belief: Belief, u: np.ndarray) -> Belief:
        """x+ = f(x, u), P+ = F P F' + Q with u (m,) common to all runs. Raises InputError for a step too coarse."""
        scan = predict_scan(self._key_for(belief.mean, u[None]), self.system.model)
        return self._run_once(scan, belief, self._step_rows(u, None))

    def update(self, belief: Belief, y: np.ndarray, active: np.ndarray) -> Belief:
        """Take in the outputs y (R, q) of those that are active, (q,) or (R, q); angle residuals wrap.

        Raises InputError for an active output that is not finite.
        """
        require_free_outputs(self.system.model, "updates apart from steps")
        is_active = np.broadcast_to(active, y.shape).astype(float)
        _require_finite(self.system, y[None], is_active[None])
        return self._run_once(update_scan(self._key(self.substeps or 1), self.system.model), belief, [y[:, None], is_active[:, None]])

    def run(self, initial: Belief, u: np.ndarray, y: np.ndarray, active: np.ndarray, increments: np.ndarray | None = None) -> Belief:
        """Return N+1 beliefs (N+1, R, ...): after the update at t_k for k < N, predicted at t_N; of a smoother, given all samples.

        u (N, m), y (N, R, q), active (N, q) or (N, R, q), increments (N, n) or (R, N, n) that the filters know to be
        added to the state after each step; None = 0. Raises InputError for an active output that is not finite, and a step too coarse.
        """
        if self.estimator.is_smoother:
            return self.report(initial, u, y, active, increments)[0]
        n, steps = initial.mean.shape[1], len(u)
        scan = filter_scan(self._key_for(initial.mean, u, increments is not None), self.system.model)
        run = scan.run(self._pack(initial), [*self._sample_rows(y, active), *self._step_rows(u, increments)], steps, carries=False)
        last = self._unpack(run.carry, n)
        means = np.concatenate([run.results[0], last.mean[:, None]], axis=1)
        covariances = np.concatenate([run.results[1].reshape(-1, steps, n, n), last.covariance[:, None]], axis=1)
        return Belief(means.swapaxes(0, 1), covariances.swapaxes(0, 1))

    def report(
        self, initial: Belief, u: np.ndarray, y: np.ndarray, active: np.ndarray, increments: np.ndarray | None = None
    ) -> tuple[Belief, SampleReports]:
        """Return the same beliefs, and what became of the samples."""
        key, n = self._key_for(initial.mean, u, increments is not None), initial.mean.shape[1]
        rows = [*self._sample_rows(y, active), *self._step_rows(u, increments)]
        run = report_scan(key, self.system.model).run(self._pack(initial), rows, len(u), carries=False)
        X, columns, *report = run.results
        reports = SampleReports(*(values.swapaxes(0, 1) for values in report[:3]), *(values.swapaxes(0, 1) > 0 for values in report[3:]))
        carries = np.concatenate([np.concatenate([X, columns], axis=2), run.carry[:, None, : self._width]], axis=1)
        if self.estimator.is_smoother:
            carries = self._smooth(key, carries, self._step_rows(u, increments))
        means, covariances = carries[..., :n], covariance_values(carries[..., self._size :], self._size, self._has_roots)[..., :n, :n]
        return Belief(means.swapaxes(0, 1), covariances.swapaxes(0, 1)), reports

    def sequential_innovations(
        self, initial: Belief, u: np.ndarray, y: np.ndarray, weights: np.ndarray, noises: Sequence[ProcessNoise]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what is new in each output after all before it, and its variance, (R, N, q), of EKFs with R process noises of one form.

        u (N, m) or (R, N, m), y and weights, how often each counts, (N, q) or (R, N, q). Independent given the past: their
        likelihood is that of the log.
        """
        is_per_speed = any(form_of(noise).is_per_speed for noise in noises)
        names = tuple(dict.fromkeys(name for noise in noises for name in noise.input_names))
        key = FilterKey(ExtendedKalmanFilter(), self.step, self.substeps or 1, self._has_roots, NoiseForm(names, is_per_speed))
        rows = np.stack([noise_row(noise, self._has_roots, key.noise) for noise in noises])
        rows = np.broadcast_to(rows[:, None], (len(rows), u.shape[-2], rows.shape[1]))
        run = innovation_scan(key, self.system.model).run(self._pack(initial), [y, weights, u, rows], u.shape[-2], carries=False)
        return run.results[0], run.results[1]

    def _smooth(self, key: FilterKey, carries: np.ndarray, step_rows: list[np.ndarray]) -> np.ndarray:
        """Return (R, N+1, .) given all samples, of the same given those until then."""
        backward, size = carries[:, -2::-1], self._size
        rows = [backward[..., :size], backward[..., size:], *(row if row.ndim == 1 else row[..., ::-1, :] for row in step_rows)]
        earlier = smoother_scan(key, self.system.model).run(carries[:, -1], rows, backward.shape[1]).carries
        return np.concatenate([earlier[:, ::-1], carries[:, -1:]], axis=1)

    def _step_rows(self, u: np.ndarray, increments: np.ndarray | None) -> list[np.ndarray]:
        return [u, self._process_noise, *([] if increments is None else [increments])]

    def _sample_rows(self, y: np.ndarray, active: np.ndarray) -> list[np.ndarray]:
        _require_finite(self.system, y, np.broadcast_to(active if active.ndim == 3 else active[:, None], y.shape))
        active_rows = active if active.ndim == 2 else np.swapaxes(active, 0, 1)
        return [np.swapaxes(y, 0, 1), active_rows.astype(float)]

    def _key_for(self, means: np.ndarray, u: np.ndarray, has_increments: bool = False) -> FilterKey:
        """Return the key for means (R, n) that move under u (N, m)."""
        if self.substeps is not None:
            return self._key(self.substeps, has_increments)
        substeps = substeps_needed(self.system, means, u, self.step, None, self.tolerance)
        return self._key(int(substeps.max(initial=1)), has_increments)

    def _key(self, substeps: int, has_increments: bool = False) -> FilterKey:
        form = form_of(self.noise) if isinstance(self.noise, ProcessNoise) else NoiseForm()
        return FilterKey(self.estimator.filter, self.step, substeps, self._has_roots, form, has_increments)

    @property
    def _nuisance(self) -> NuisanceStates:
        return nuisance_of(self.system.model, self.step)

    @property
    def _has_roots(self) -> bool:
        return bool(self._nuisance.size) or self.estimator.is_smoother or self.estimator.filter.needs_roots

    @property
    def _size(self) -> int:
        """The number of states, nuisance states among them."""
        return len(self.system.model.states) + self._nuisance.size

    @property
    def _width(self) -> int:
        """How many numbers mean and spread are."""
        size = self._size
        return size + (size * size if self._has_roots else size * (size + 1) // 2)

    @property
    def _process_noise(self) -> np.ndarray:
        if isinstance(self.noise, ProcessNoise):
            return noise_row(self.noise, self._has_roots)
        return spread_values(np.asarray(self.noise, dtype=float), self._has_roots)

    def _run_once(self, scan: Scan, belief: Belief, rows: list[np.ndarray]) -> Belief:
        return self._unpack(scan.run(self._pack(belief), rows, 1, carries=False, results=False).carry, belief.mean.shape[1])

    def _pack(self, belief: Belief) -> np.ndarray:
        """Return the carry (R, .) of beliefs, before the first sample where nothing is known of nuisance states."""
        if belief.carry is not None:
            return belief.carry
        (runs, n), size, nuisance = belief.mean.shape, self._size, self._nuisance
        spread = belief.covariance
        if nuisance.size:
            spread, a = np.zeros((runs, size, size)), len(nuisance.coloured)
            spread[:, :n, :n] = root_values(belief.covariance)
            spread[:, n : n + a, n : n + a] = root_values(nuisance.R)
            spread[:, n + a :, n + a :] = np.eye(len(nuisance.constant))
            columns = spread.swapaxes(1, 2).reshape(runs, -1)
        else:
            columns = spread_values(spread, self._has_roots)
        counters = np.tile(counter_values(self.estimator.filter.gate, len(self.system.model.channels)), (runs, 1))
        return np.hstack([belief.mean, np.zeros((runs, nuisance.size)), columns, counters])

    def _unpack(self, carry: np.ndarray, n: int) -> Belief:
        columns = carry[:, self._size : self._width]
        is_whole = not (self._has_roots or self.estimator.filter.gate)
        return Belief(carry[:, :n], covariance_values(columns, self._size, self._has_roots)[:, :n, :n], None if is_whole else carry)


def _require_finite(system: AbstractSystem, y: np.ndarray, active: np.ndarray) -> None:
    """Raise InputError for the first of the outputs y (N, R, q) that is active and not finite: it would make everything nan."""
    if all_finite(y):
        return
    wrong = np.argwhere((active > 0) & ~np.isfinite(y))
    if len(wrong):
        k, run, column = wrong[0]
        name = system.model.outputs[column].name
        raise InputError(f"y[{k}, {run}, {column}] ({name}) is {y[k, run, column]}: what is active must be finite")
