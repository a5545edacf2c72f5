"""What each sensor, where it is read, says about the state of that instant."""

from __future__ import annotations

import numpy as np

from obsdesign.compile import sample_information, steps_per_sample
from obsdesign.errors import InputError
from obsdesign.model import AbstractSystem
from obsdesign.trajectory import Trajectory


def sampled(system: AbstractSystem, steps: int, step: float) -> np.ndarray:
    """Return (N, S) bool: True where sensor s has a sample at t_k; the first sample is at t_0."""
    periods = np.array(steps_per_sample(system, step), dtype=int).reshape(1, -1)
    return np.arange(steps)[:, None] % periods == 0


def local_information(system: AbstractSystem, path: Trajectory) -> np.ndarray:
    """Return C_sk' R_s^-1 C_sk (N, S, n, n) of every sample about x(t_k), 0 where there is none.

    Raises InputError, with the sensor and the step, for a sample that has no derivative: the path meets a landmark.
    """
    n, steps = path.x.shape[1], path.steps
    every = sample_information(system).map(steps)(path.x[:-1].T, np.tile(np.eye(n), steps)).full()
    blocks = every.reshape(n, steps, -1, n).transpose(1, 2, 0, 3)
    return with_derivatives(np.where(sampled(system, steps, path.step)[:, :, None, None], blocks, 0.0), system, path)


def with_derivatives(blocks: np.ndarray, system: AbstractSystem, path: Trajectory) -> np.ndarray:
    """Return blocks (N, S, n, n), or raise InputError with the sensor and the step for the first that is not finite."""
    if not np.isfinite(blocks).all():
        k, s = np.argwhere(~np.isfinite(blocks))[0][:2]
        name = system.model.sensor_names[s]
        raise InputError(f"sensor {name!r} has no derivative at step {k} (t = {path.t[k]:g} s): the path meets its landmark")
    return blocks
