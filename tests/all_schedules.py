"""Every schedule of a small problem at once, with a Kalman filter of the tests' own: what they cost, use and know."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import casadi as ca
import numpy as np
from scipy.linalg import expm

import obsdesign as od

_EXACT = 1e-11  # relative error of steps: those of the reference are matrix exponentials


@dataclass(frozen=True, eq=False)
class SmallProblem:
    """A linear system x' = A x, outputs C x with sigma 1, K segments of so many steps, samples that arrive (N, S)."""

    A: np.ndarray
    C: np.ndarray
    segments: int
    steps: int
    step: float
    per_segment: int
    prior: od.Prior
    psd: np.ndarray
    arrivals: np.ndarray

    @property
    def system(self) -> od.ControlAffineSystem:
        """The system for the package, states s0, s1, ... in m, outputs y0, y1, ..."""
        x = ca.SX.sym("x", len(self.A))
        outputs = {f"y{s}": ca.mtimes(ca.DM(row[None]), x) for s, row in enumerate(self.C)}
        return od.ControlAffineSystem(x, tuple(f"s{i}" for i in range(len(self.A))), drift=ca.mtimes(ca.DM(self.A), x), outputs=outputs)

    @property
    def question(self) -> dict:
        """What both questions of the package take."""
        system, n = self.system, len(self.A)
        path = od.simulate(system, np.zeros(n), np.zeros((len(self.arrivals), 0)), self.step, tolerance=_EXACT)
        return {
            "system": system,
            "path": path,
            "prior": self.prior,
            "per_segment": self.per_segment,
            "segment": self.steps * self.step,
            "disturbance_psd": self.psd,
            "active": self.arrivals,
        }

    @property
    def schedules(self) -> np.ndarray:
        """All of them (B, K, S)."""
        S = len(self.C)
        rows = [np.isin(np.arange(S), on) for size in range(self.per_segment + 1) for on in combinations(range(S), size)]
        return np.array(list(product(rows, repeat=self.segments)))

    def covariances(self, schedules: np.ndarray) -> np.ndarray:
        """Return P (B, N, n, n) after the samples at t_k, by Joseph's form."""
        F, P, result = expm(self.A * self.step), np.repeat(self.prior.covariance[None], len(schedules), axis=0), []
        for k, arrives in enumerate(self.arrivals > 0):
            on = schedules[:, k // self.steps] & arrives
            for row, is_on in zip(self.C, on.T, strict=True):
                gain = P @ row / (1 + P @ row @ row)[:, None] * is_on[:, None]
                rest = np.eye(len(F)) - gain[:, :, None] * row
                P = rest @ P @ rest.swapaxes(1, 2) + gain[:, :, None] * gain[:, None, :]
            result.append(P)
            P = F @ P @ F.T + np.diag(self.psd) * self.step
        return np.array(result).swapaxes(0, 1)


def random_problem(random: np.random.Generator, most: int) -> SmallProblem:
    """Return a problem of at most so many schedules, with outages, with and without process noise."""
    S = int(random.integers(1, 4))
    per_segment = int(random.integers(1, min(S, 2) + 1))
    rows = sum(len(list(combinations(range(S), size))) for size in range(per_segment + 1))
    K = int(random.integers(1, max(1, int(np.log(most) / np.log(rows))) + 1))
    n, steps = int(random.integers(1, 4)), int(random.integers(1, 4))
    return SmallProblem(
        random.normal(size=(n, n)) - np.eye(n),
        random.normal(size=(S, n)),
        K,
        steps,
        float(random.uniform(0.05, 0.5)),
        per_segment,
        od.Prior(mean=np.zeros(n), std=np.exp(random.normal(size=n))),
        np.exp(random.normal(size=n)) * (random.random() < 0.8),
        (random.random((K * steps, S)) < random.choice([0.6, 1.0])).astype(float),
    )


def switch_ons(schedules: np.ndarray) -> np.ndarray:
    """Return how often each sensor is switched on (B, S)."""
    before = np.zeros_like(schedules)
    before[:, 1:] = schedules[:, :-1]
    return (schedules & ~before).sum(axis=1)


def keeps_dwell(schedules: np.ndarray, least: int) -> np.ndarray:
    """Return which schedules (B,) keep every sensor on for at least so many segments, or to the end."""
    before = np.zeros_like(schedules)
    before[:, 1:] = schedules[:, :-1]
    starts, result = schedules & ~before, np.ones(len(schedules), dtype=bool)
    for later in range(1, least):
        result &= ~(starts[:, : schedules.shape[1] - later] & ~schedules[:, later:]).any(axis=(1, 2))
    return result
