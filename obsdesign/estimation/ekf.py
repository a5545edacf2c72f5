"""The extended Kalman filter, for many runs at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from obsdesign.calculus import wrap_columns
from obsdesign.compile import output, transition
from obsdesign.model import AbstractSystem


@dataclass(frozen=True, eq=False)
class Belief:
    """What the filters of R runs believe: mean (R, n), covariance (R, n, n)."""

    mean: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class ExtendedKalmanFilter:
    """Predict and update for `runs` filters of one system side by side; noise (n, n): process covariance of one step."""

    system: AbstractSystem
    step: float
    noise: np.ndarray
    runs: int

    def predict(self, belief: Belief, u: np.ndarray) -> Belief:
        """x+ = f(x, u), P+ = F P F' + Q with u (m,) common to all runs."""
        runs, n = belief.mean.shape
        idle = np.zeros((len(self.system.model.unknown_inputs), runs))
        x, F, _ = self._transition(belief.mean.T, np.tile(u[:, None], runs), idle)
        F = stacked(F, runs, n)
        return Belief(x.full().T, symmetric(F @ belief.covariance @ F.swapaxes(1, 2) + self.noise))

    def update(self, belief: Belief, y: np.ndarray, active: np.ndarray) -> Belief:
        """Take in the outputs y (R, q) of those sensors that are active (q,); angle residuals wrap. Joseph's form."""
        if not active.any():
            return belief
        runs, n = belief.mean.shape
        model = self.system.model
        expected, C = self._output(belief.mean.T)
        C = stacked(C, runs, n)[:, active]
        is_angle = np.array([signal.is_angle for signal in model.outputs])
        residual = wrap_columns(y - expected.full().T, is_angle)[:, active]
        R = np.diag(np.square(model.sigmas))[np.ix_(active, active)]
        P = belief.covariance
        gain = np.linalg.solve(C @ P @ C.swapaxes(1, 2) + R, C @ P).swapaxes(1, 2)
        remaining = np.eye(n) - gain @ C
        covariance = remaining @ P @ remaining.swapaxes(1, 2) + gain @ R @ gain.swapaxes(1, 2)
        return Belief(belief.mean + (gain @ residual[:, :, None])[:, :, 0], symmetric(covariance))

    def run(self, first: Belief, u: np.ndarray, y: np.ndarray, active: np.ndarray) -> Iterator[Belief]:
        """Yield N+1 beliefs: after the update at t_k for k < N, predicted at t_N. u (N, m), y (N, R, q), active (N, q)."""
        belief = first
        for k in range(len(u)):
            updated = self.update(belief, y[k], active[k])
            yield updated
            belief = self.predict(updated, u[k])
        yield belief

    @cached_property
    def _transition(self) -> ca.Function:
        return transition(self.system, self.step).map(self.runs)

    @cached_property
    def _output(self) -> ca.Function:
        return output(self.system).map(self.runs)


def stacked(wide: ca.DM, runs: int, columns: int) -> np.ndarray:
    """Return (R, rows, columns) from R matrices that CasADi's map set side by side (rows, R columns)."""
    values = wide.full()
    return values.reshape(len(values), runs, columns).transpose(1, 0, 2)


def symmetric(P: np.ndarray) -> np.ndarray:
    """(P + P') / 2 for each of a stack of matrices."""
    return (P + P.swapaxes(-1, -2)) / 2
