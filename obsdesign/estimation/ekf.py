"""The extended Kalman filter, for many runs at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.checks import all_finite
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.nuisance_states import NuisanceStates, nuisance_of
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import substeps_needed
from obsdesign.dynamics.step import CACHE_SIZE, Step, looped_step
from obsdesign.errors import InputError
from obsdesign.estimation._square_root_scans import FilterScans, root_belief, root_of, root_scans, root_start
from obsdesign.packing import pack, pack_values, symmetric, unpack
from obsdesign.trajectory import TOLERANCE


@dataclass(frozen=True, eq=False)
class Belief:
    """What the filters of R runs believe: mean (..., R, n), covariance (..., R, n, n).

    carry (R, .): the same with the nuisance states of samples whose errors last, as the next step takes it; None: nothing has
    been learned of them yet.
    """

    mean: np.ndarray
    covariance: np.ndarray
    carry: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class ExtendedKalmanFilter:
    """Predict and update filters of one system side by side; noise (n, n): process covariance of one step of `step` seconds.

    The filter's own model of the samples is the one that is stated: correlated, constant and joint errors are nuisance states
    beside x, see `NuisanceStates`. A sample has then nothing white left, and covariances are carried as roots.
    substeps: of how many each step is made; None: as many as `tolerance` asks for along the motion of the means without samples.
    """

    system: AbstractSystem
    step: float
    noise: np.ndarray
    substeps: int | None = None
    tolerance: float = TOLERANCE

    def predict(self, belief: Belief, u: np.ndarray) -> Belief:
        """x+ = f(x, u), P+ = F P F' + Q with u (m,) common to all runs. Raises InputError for a step too coarse."""
        return self._run_once(self._scans_for(belief.mean, u[None]).predict, belief, [u, self._process_noise])

    def update(self, belief: Belief, y: np.ndarray, active: np.ndarray) -> Belief:
        """Take in the outputs y (R, q) of those that are active, (q,) or (R, q); angle residuals wrap.

        Raises InputError for an active output that is not finite.
        """
        is_active = np.broadcast_to(active, y.shape).astype(float)
        _require_finite(self.system, y[None], is_active[None])
        return self._run_once(self._scans(self.substeps or 1).update, belief, [y[:, None], is_active[:, None]])

    def run(self, initial: Belief, u: np.ndarray, y: np.ndarray, active: np.ndarray) -> Belief:
        """Return N+1 beliefs (N+1, R, ...): after the update at t_k for k < N, predicted at t_N.

        u (N, m), y (N, R, q), active (N, q) or (N, R, q). Raises InputError for an active output that is not finite, and a step too
        coarse.
        """
        _require_finite(self.system, y, np.broadcast_to(active if active.ndim == 3 else active[:, None], y.shape))
        n, steps = initial.mean.shape[1], len(u)
        active_rows = active if active.ndim == 2 else np.swapaxes(active, 0, 1)
        rows = [u, np.swapaxes(y, 0, 1), active_rows.astype(float), self._process_noise]
        run = self._scans_for(initial.mean, u).update_predict.run(self._pack(initial), rows, steps, carries=False)
        last = self._unpack(run.carry, n)
        means = np.concatenate([run.results[0], last.mean[:, None]], axis=1)
        covariances = np.concatenate([run.results[1].reshape(-1, steps, n, n), last.covariance[:, None]], axis=1)
        return Belief(means.swapaxes(0, 1), covariances.swapaxes(0, 1))

    def _scans_for(self, means: np.ndarray, u: np.ndarray) -> FilterScans:
        """Return the walks for means (R, n) that move under u (N, m)."""
        if self.substeps is not None:
            return self._scans(self.substeps)
        return self._scans(int(substeps_needed(self.system, means, u, self.step, None, self.tolerance).max(initial=1)))

    def _scans(self, substeps: int) -> FilterScans:
        model = self.system.model
        return root_scans(model, self.step, substeps) if self._nuisance.size else _scans(model, self.step, substeps)

    @property
    def _nuisance(self) -> NuisanceStates:
        return nuisance_of(self.system.model, self.step)

    @property
    def _process_noise(self) -> np.ndarray:
        noise = np.asarray(self.noise, dtype=float)
        return root_of(noise).ravel() if self._nuisance.size else pack_values(noise)

    def _run_once(self, scan: Scan, belief: Belief, rows: list[np.ndarray]) -> Belief:
        return self._unpack(scan.run(self._pack(belief), rows, 1, carries=False).carry, belief.mean.shape[1])

    def _pack(self, belief: Belief) -> np.ndarray:
        if not self._nuisance.size:
            return _pack(belief)
        return root_start(belief.mean, belief.covariance, self._nuisance) if belief.carry is None else belief.carry

    def _unpack(self, carry: np.ndarray, n: int) -> Belief:
        if not self._nuisance.size:
            return Belief(carry[:, :n], unpack(carry[:, n:], n))
        return Belief(*root_belief(carry, n, self._nuisance), carry)


def _require_finite(system: AbstractSystem, y: np.ndarray, active: np.ndarray) -> None:
    """Raise InputError for the first of the outputs y (N, R, q) that is active and not finite: it would make everything nan."""
    if all_finite(y):
        return
    wrong = np.argwhere((active > 0) & ~np.isfinite(y))
    if len(wrong):
        k, run, column = wrong[0]
        name = system.model.outputs[column].name
        raise InputError(f"y[{k}, {run}, {column}] ({name}) is {y[k, run, column]}: what is active must be finite")


def _pack(belief: Belief) -> np.ndarray:
    return np.hstack([belief.mean, pack_values(belief.covariance)])


@lru_cache(CACHE_SIZE)
def _scans(model: Model, step: float, substeps: int) -> FilterScans:
    return FilterScans(_predict_scan(model, step, substeps), _update_scan(model), _filter_scan(model, step, substeps))


@lru_cache(CACHE_SIZE)
def _predict_scan(model: Model, step: float, substeps: int) -> Scan:
    step_graph = looped_step(model, step, substeps).without_disturbance()
    n = step_graph.x.numel()
    (P, carry), (Q, noise_entries) = symmetric("P", n), symmetric("Q", n)
    rows, carry_next = [step_graph.u, noise_entries], _predict_carry(step_graph, P, Q)
    return Scan(ca.vertcat(step_graph.x, carry), rows, carry_next, loop=step_graph.loop)


@lru_cache(CACHE_SIZE)
def _update_scan(model: Model) -> Scan:
    P, carry = symmetric("P", model.x.numel())
    y, active = (ca.SX.sym(name, len(model.outputs)) for name in ("y", "active"))
    mean, covariance = _linear_update(model, P, y, active)
    return Scan(ca.vertcat(model.x, carry), [y, active], ca.vertcat(mean, pack(covariance)))


@lru_cache(CACHE_SIZE)
def _filter_scan(model: Model, step: float, substeps: int) -> Scan:
    """One update and one prediction; results: mean (n,) and covariance (n n,) between them."""
    step_graph = looped_step(model, step, substeps).without_disturbance()
    n = model.x.numel()
    (P, carry), (Q, noise_entries) = symmetric("P", n), symmetric("Q", n)
    y, active = (ca.SX.sym(name, len(model.outputs)) for name in ("y", "active"))
    mean, covariance = _linear_update(model, P, y, active)
    step_graph = step_graph.starting_at(mean)
    rows, results = [step_graph.u, y, active, noise_entries], [mean, ca.vec(covariance)]
    return Scan(ca.vertcat(model.x, carry), rows, _predict_carry(step_graph, covariance, Q), results, loop=step_graph.loop)


def _predict_carry(step: Step, P: ca.SX, Q: ca.SX) -> ca.SX:
    """(f(x, u), lower triangle of F P F' + Q)."""
    return ca.vertcat(step.x_next, pack(step.F @ P @ step.F.T + Q))


def _linear_update(model: Model, P: ca.SX, y: ca.SX, active: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Mean and covariance after the active outputs, one by one: with independent noise the same as all at once.

    All are linearised at the predicted mean. R is what information counts for a sample that has arrived.
    """
    C = ca.jacobian(model.h, model.x)
    R = ca.vertcat(*[ca.SX.ones(len(channel.outputs)) * channel.noise.variance for channel in model.channels])
    correction = ca.SX.zeros(model.x.numel())
    for i, signal in enumerate(model.outputs):
        # an output that is off must not matter, not even where it has no derivative
        row = ca.if_else(active[i], C[i, :], 0)
        residual = ca.if_else(active[i], y[i] - model.h[i], 0)
        if signal.is_angle:
            residual = ca.remainder(residual, 2 * np.pi)
        cross_covariance = P @ row.T
        gain = cross_covariance / (row @ cross_covariance + ca.if_else(active[i], R[i], 1))
        correction += gain * (residual - row @ correction)
        P = P - gain @ cross_covariance.T
    return model.x + correction, P
