"""A straight flight past four beacons, small enough for any planner."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

import obsdesign as od
from benchmarks.kalman_reference import LinearRun, mean_weights

BEACONS = ((1280.0, 140.0), (880.0, -150.0), (640.0, 170.0), (80.0, -30.0))
START, UNITS, PSD, SIGMA = (0.0, 15.0, 0.0, 1.0), (5.0, 5.0, 5.0, 5.0), (0.1, 0.05, 0.1, 0.05), 1.0
SAMPLES, STEP = 5, 1.0  # per segment; s
_NAMES, POSITION = ("x", "speed_x", "y", "speed_y"), [0, 2]


@dataclass(frozen=True)
class StraightFlight:
    """K segments of a flight with nearly constant velocity, for the library and for the reference."""

    segments: int

    @cached_property
    def system(self) -> od.ControlAffineSystem:
        """A vehicle of nearly constant velocity with four ranges."""
        x = ca.SX.sym("x", 4)
        ranges = {f"beacon_{i}": ((x[0] - east) ** 2 + (x[2] - north) ** 2) ** 0.5 for i, (east, north) in enumerate(BEACONS)}
        return od.ControlAffineSystem(x, _NAMES, ca.vertcat(x[1], 0, x[3], 0), outputs=ranges, sigmas=dict.fromkeys(ranges, SIGMA))

    @cached_property
    def path(self) -> od.Trajectory:
        """The flight."""
        return od.simulate(self.system, START, np.zeros((SAMPLES * self.segments, 0)), STEP)

    @cached_property
    def prior(self) -> od.Prior:
        """What is known at the start."""
        return od.Prior(START, UNITS)

    @cached_property
    def reference(self) -> LinearRun:
        """The same for the filter in plain NumPy."""
        count = SAMPLES * self.segments
        x = np.array(START) + np.outer(STEP * np.arange(count), [START[1], 0.0, START[3], 0.0])
        rows = np.zeros((count, len(BEACONS), 1, 4))
        for s, beacon in enumerate(BEACONS):
            offset = x[:, POSITION] - beacon
            rows[:, s, 0, POSITION] = offset / np.linalg.norm(offset, axis=1, keepdims=True) / SIGMA
        transitions = np.tile(transition_matrix(), (count, 1, 1))
        segment = np.repeat(np.arange(self.segments), SAMPLES)
        return LinearRun(
            transitions, np.diag(PSD) * STEP, np.diag(np.square(UNITS)), rows, segment, np.eye(4)[POSITION], mean_weights(count)
        )


def transition_matrix() -> np.ndarray:
    """Return F (4, 4) of one step."""
    return np.kron(np.eye(2), [[1.0, STEP], [0.0, 1.0]])
