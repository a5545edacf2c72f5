"""What each sensor, where it is read, says about the state of that instant."""

from __future__ import annotations

import numpy as np

from obsdesign.checks import all_finite
from obsdesign.errors import InputError
from obsdesign.model import AbstractSystem
from obsdesign.step import steps_per_sample
from obsdesign.trajectory import Trajectory


def sampled(system: AbstractSystem, steps: int, step: float, first: int = 0) -> np.ndarray:
    """Return (N, S) bool: True where sensor s has a sample at t_k, k = first .. first + N - 1; the first sample is at t_0."""
    periods = np.array(steps_per_sample(system.model, step), dtype=int).reshape(1, -1)
    return np.arange(first, first + steps)[:, None] % periods == 0


def sampled_only(blocks: np.ndarray, system: AbstractSystem, step: float) -> np.ndarray:
    """Return blocks (N, S, ...) with those set to 0, in place, where there is no sample."""
    if any(period > 1 for period in steps_per_sample(system.model, step)):
        blocks[~sampled(system, len(blocks), step)] = 0.0
    return blocks


def with_derivatives(blocks: np.ndarray, system: AbstractSystem, path: Trajectory) -> np.ndarray:
    """Return blocks (N, S, n, n), read-only, or raise InputError with the sensor and the step for the first that is not finite."""
    if not all_finite(blocks):
        k, s = np.argwhere(~np.isfinite(blocks))[0][:2]
        name = system.model.sensor_names[s]
        raise InputError(f"sensor {name!r} has no derivative at step {k} (t = {path.t[k]:g} s): the path meets its landmark")
    blocks.setflags(write=False)
    return blocks
