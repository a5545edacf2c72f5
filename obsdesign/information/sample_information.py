"""What each sensor, where it is read, says about the state of that instant."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from obsdesign.checks import all_finite
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import inputs_along
from obsdesign.dynamics.step import CACHE_SIZE, blocks_of, dense_blocks, steps_per_sample
from obsdesign.errors import InputError
from obsdesign.information.correlated_noise import Colour
from obsdesign.information.correlated_samples import CorrelatedSamples
from obsdesign.trajectory import Trajectory


def sampling_mask(system: AbstractSystem, steps: int, step: float, first: int = 0) -> np.ndarray:
    """Return (N, S) bool: True where sensor s has a sample at t_k, k = first .. first + N - 1; the first sample is at t_0."""
    periods = np.array(steps_per_sample(system.model, step), dtype=int).reshape(1, -1)
    return np.arange(first, first + steps)[:, None] % periods == 0


def zero_unsampled(blocks: np.ndarray, system: AbstractSystem, step: float) -> np.ndarray:
    """Return blocks (N, S, ...) with those set to 0, in place, where there is no sample."""
    if any(period > 1 for period in steps_per_sample(system.model, step)):
        blocks[~sampling_mask(system, len(blocks), step)] = 0.0
    return blocks


def samples_with_colour(
    system: AbstractSystem, colour: Colour, rows: np.ndarray, level: np.ndarray, gate: np.ndarray, step: float
) -> CorrelatedSamples:
    """Return the samples of coloured outputs, rows (N, q, n), level and gate (N, q), 0 where there is none."""
    sampling = sampling_mask(system, len(rows), step)[:, colour.sensor_of_output]
    return samples_at(colour, (rows, level, gate), sampling, np.arange(len(rows)), len(rows))


def samples_at(
    colour: Colour,
    values: tuple[np.ndarray, np.ndarray, np.ndarray],
    sampling: np.ndarray,
    step: np.ndarray,
    steps: int,
    *,
    decay: np.ndarray | None = None,
) -> CorrelatedSamples:
    """Return the samples of coloured outputs at instants in steps, values rows (M, q, n), level and gate (M, q), where there is one."""
    rows, level, gate = values
    level, gate = np.where(sampling, level, 0.0), np.where(sampling, gate, 0.0)
    return CorrelatedSamples(colour, np.where(sampling[..., None], rows, 0.0), level, gate, sampling, step, steps, decay)


def require_finite_blocks(blocks: np.ndarray, system: AbstractSystem, path: Trajectory) -> np.ndarray:
    """Return blocks (N, S, n, n), read-only, or raise InputError for the first that is not finite, and why."""
    if not all_finite(blocks):
        is_not_finite = np.asarray(~np.isfinite(blocks).all(axis=(2, 3)))
        require_derivatives(system, path, is_not_finite)
        k = int(np.argwhere(is_not_finite)[0, 0])
        raise InputError(f"the information is not finite at step {k} (t = {path.t[k]:g} s): the sensitivity to the start overflows")
    blocks.setflags(write=False)
    return blocks


def require_derivatives(system: AbstractSystem, path: Trajectory, requested: np.ndarray) -> None:
    """Raise InputError with the sensor and the step for the first sample of those asked (N, S) that has no derivative."""
    n = path.x.shape[1]
    rows = [values[: len(requested)] for values in (path.x, inputs_along(system, path)[0])]
    local = _local_scan(system.model).along(np.empty(0), *rows)[1].reshape(len(requested), -1, n, n)
    missing = requested & ~np.isfinite(local).all(axis=(2, 3))
    if missing.any():
        k, s = np.argwhere(missing)[0]
        name = system.model.sensor_names[s]
        raise InputError(f"sensor {name!r} has no derivative at step {k} (t = {path.t[k]:g} s): the path meets its landmark")


@lru_cache(CACHE_SIZE)
def _local_scan(model: Model) -> Scan:
    import casadi as ca

    return Scan(ca.SX(0, 1), [model.x, model.u], ca.SX(0, 1), [dense_blocks(blocks_of(model, ca.SX.eye(model.x.numel())))])
