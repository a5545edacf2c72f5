"""Flights past a beacon in a constant wind, once for the library and once by hand for the reference."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

import obsdesign as od
from benchmarks.kalman_reference import LinearRun, mean_weights

BEACON, SPEED, START = (200.0, 150.0), 15.0, (0.0, 0.0, 0.4, 2.0, -1.0)
GPS_SIGMA, COMPASS_SIGMA, RANGE_SIGMA, BEARING_SIGMA = 10.0, 0.05, 1.0, 0.03
UNITS = (20.0, 20.0, 0.3, 3.0, 3.0)  # the prior's standard deviations, and what counts as one unit
PSD = (0.25, 0.25, 1e-3, 0.02, 0.02)
_SUBSTEPS = 4  # of the reference: far below the library's tolerance of a step


@dataclass(frozen=True)
class Flight:
    """K segments of `per_segment` steps: circles that drift and swell, one in about two minutes."""

    segments: int
    seed: int
    per_segment: int = 5
    step: float = 1.0

    @property
    def length(self) -> float:
        """Length of a segment [s]."""
        return self.per_segment * self.step

    @cached_property
    def turn_rates(self) -> np.ndarray:
        """Turn rates (N,) [rad/s]."""
        random = np.random.default_rng(self.seed)
        rates, phases = random.uniform(0.02, 0.4, 6), random.uniform(0, 2 * np.pi, 6)
        t = self.step * np.arange(self.segments * self.per_segment)
        return 0.05 + 0.05 * np.sin(np.outer(t, rates) + phases).sum(axis=1)

    @cached_property
    def system(self) -> od.System:
        """GPS, compass, range and bearing."""
        beacon_sensors = (od.Range(BEACON, RANGE_SIGMA), od.Bearing(BEACON, BEARING_SIGMA))
        return od.System(od.Dubins(SPEED, wind="constant"), (od.GPS(GPS_SIGMA), od.Magnetometer(COMPASS_SIGMA), *beacon_sensors))

    @cached_property
    def path(self) -> od.Trajectory:
        """The path, by the library."""
        return od.simulate(self.system, START, self.turn_rates[:, None], self.step)

    @cached_property
    def prior(self) -> od.Prior:
        """What is known at the start."""
        return od.Prior(START, UNITS)

    @cached_property
    def reference(self) -> LinearRun:
        """The same for the filter in plain NumPy, whose derivatives are written by hand."""
        states, transitions = _flown(np.array(START), self.turn_rates, self.step)
        rows = _rows(states)
        segment = np.repeat(np.arange(self.segments), self.per_segment)
        unit = np.diag(1.0 / np.array(UNITS))
        return LinearRun(transitions, np.diag(PSD) * self.step, np.diag(np.square(UNITS)), rows, segment, unit, mean_weights(len(rows)))


def _rate(x: np.ndarray, turn_rate: float) -> np.ndarray:
    return np.array([SPEED * np.cos(x[2]) + x[3], SPEED * np.sin(x[2]) + x[4], turn_rate, 0.0, 0.0])


def _slope(x: np.ndarray) -> np.ndarray:
    A = np.zeros((5, 5))
    A[0, 2], A[1, 2], A[0, 3], A[1, 4] = -SPEED * np.sin(x[2]), SPEED * np.cos(x[2]), 1.0, 1.0
    return A


def _flown(x: np.ndarray, turn_rates: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return states (N, 5) and dx_k+1/dx_k (N, 5, 5) by RK4 and its derivative."""
    states, transitions, h = [], [], step / _SUBSTEPS
    for turn_rate in turn_rates:
        states.append(x)
        F = np.eye(5)
        for _ in range(_SUBSTEPS):
            k1, A1 = _rate(x, turn_rate), _slope(x) @ F
            k2, A2 = _rate(x + h / 2 * k1, turn_rate), _slope(x + h / 2 * k1) @ (F + h / 2 * A1)
            k3, A3 = _rate(x + h / 2 * k2, turn_rate), _slope(x + h / 2 * k2) @ (F + h / 2 * A2)
            k4, A4 = _rate(x + h * k3, turn_rate), _slope(x + h * k3) @ (F + h * A3)
            x, F = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), F + h / 6 * (A1 + 2 * A2 + 2 * A3 + A4)
        transitions.append(F)
    return np.array(states), np.array(transitions)


def _rows(states: np.ndarray) -> np.ndarray:
    """Return rows (N, 4, 2, 5) of samples whose noise has variance 1."""
    rows = np.zeros((len(states), 4, 2, 5))
    east, north = BEACON[0] - states[:, 0], BEACON[1] - states[:, 1]
    r = np.hypot(east, north)
    rows[:, 0, 0, 0] = rows[:, 0, 1, 1] = 1 / GPS_SIGMA
    rows[:, 1, 0, 2] = 1 / COMPASS_SIGMA
    rows[:, 2, 0, 0], rows[:, 2, 0, 1] = -east / r / RANGE_SIGMA, -north / r / RANGE_SIGMA
    rows[:, 3, 0, 0], rows[:, 3, 0, 1] = north / r**2 / BEARING_SIGMA, -east / r**2 / BEARING_SIGMA
    rows[:, 3, 0, 2] = -1 / BEARING_SIGMA
    return rows
