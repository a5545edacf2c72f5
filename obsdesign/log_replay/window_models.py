"""Linear models of windows in a few steps each: what the samples of each sensor say, and what is known without one of them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from obsdesign.dynamics.process_noise import noise_of
from obsdesign.dynamics.simulation import simulate
from obsdesign.information.linearisation import linearise
from obsdesign.information.recorded_samples import recorded_samples
from obsdesign.log_replay.event_path import DrivenPath, part_of_log
from obsdesign.log_replay.question import ReplayQuestion
from obsdesign.logs.events import input_integrals

_STEPS = 20  # of a window: process noise enters at their ends


@dataclass(frozen=True, eq=False)
class WindowModels:
    """K windows of L steps: F and Q (K, L, n, n) of each step, blocks (K, L, S, n, n) of the samples in it about its beginning.

    The path of a window is that of the model from its first state on, with the inputs of the log: what is hidden stays hidden to
    rounding. Errors of samples count as independent, by the variance of a sample alone.
    """

    F: np.ndarray
    Q: np.ndarray
    blocks: np.ndarray

    @property
    def gramians(self) -> np.ndarray:
        """W (K, n, n) about the state at the beginning of each window."""
        Phi, total = np.broadcast_to(np.eye(self.F.shape[-1]), self.F[:, 0].shape), np.zeros_like(self.F[:, 0])
        for step in range(self.F.shape[1]):
            total = total + Phi.swapaxes(1, 2) @ self.blocks[:, step].sum(axis=1) @ Phi
            Phi = self.F[:, step] @ Phi
        return total

    def chained_priors(self, P0: np.ndarray) -> np.ndarray:
        """Return the covariance (K, n, n) before the samples of each window, given P0 (n, n) before those of the first."""
        priors = [P0]
        for k in range(len(self.F) - 1):
            priors.append(self._advance(priors[-1][None], slice(k, k + 1), np.ones(self.blocks.shape[2]))[1][0])
        return np.array(priors)

    def growth(self, priors: np.ndarray, question: ReplayQuestion) -> np.ndarray:
        """Return by what factor the predicted error grows when a sensor is left out (K, S), given priors (K, n, n) of windows."""
        every = slice(None)
        sensors = self.blocks.shape[2]
        total = question_sizes(question, self._advance(priors, every, np.ones(sensors))[0])
        without = [question_sizes(question, self._advance(priors, every, np.arange(sensors) != s)[0]) for s in range(sensors)]
        return np.column_stack(without) / total[:, None]

    def _advance(self, P: np.ndarray, windows: slice, active: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return covariances (k, L, n, n) after the samples of each step, and (k, n, n) at the end, of windows, active (S,)."""
        unit = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
        square, after = unit[:, :, None] * unit[:, None, :], []
        for step in range(self.F.shape[1]):
            information = np.tensordot(self.blocks[windows, step], active, axes=(1, 0))
            J = np.linalg.inv(P / square) + information * square
            P = np.linalg.inv(J) * square
            after.append(P)
            F = self.F[windows, step]
            P = F @ P @ F.swapaxes(1, 2) + self.Q[windows, step]
        return np.stack(after, axis=1), P


def question_sizes(question: ReplayQuestion, covariances: np.ndarray) -> np.ndarray:
    """Return the root mean square size (K,) of what counts, of covariances (K, L, n, n)."""
    return np.sqrt(np.mean(question.size_of(covariances) ** 2, axis=1))


def window_models(question: ReplayQuestion, driven: DrivenPath, bounds: np.ndarray) -> WindowModels:
    """Return the models of windows between events bounds (K+1,)."""
    parts = [_window_model(question, driven, int(first), int(last)) for first, last in pairwise(bounds)]
    return WindowModels(*(np.array(values) for values in zip(*parts, strict=True)))


def _window_model(question: ReplayQuestion, driven: DrivenPath, first: int, last: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    system, log = question.system, question.log
    t = np.linspace(driven.path.t[first], driven.path.t[last], _STEPS + 1)
    model, dt = system.model, float(t[1] - t[0])
    path = simulate(system, driven.path.x[first], input_integrals(model, log, t) / dt, dt)
    noise = noise_of(model, question.disturbance_psd, question.input_psd, path.pace)
    linear = linearise(system, path, np.zeros((_STEPS, len(model.channels))), noise)
    n, blocks = len(model.states), np.zeros((_STEPS, len(model.channels), len(model.states), len(model.states)))
    if ((log.samples.t >= t[0]) & (log.samples.t < t[-1])).any():
        shifted = type(path)(t, path.x, path.u, tolerance=path.tolerance)
        blocks = recorded_samples(system, shifted, part_of_log(log, t[0], t[-1])).local_blocks
    Q = linear.noise @ linear.noise.swapaxes(1, 2) if linear.noise.size else np.zeros((_STEPS, n, n))
    return linear.F, Q, blocks
