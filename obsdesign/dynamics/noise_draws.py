"""Process noise as it is drawn along a path, for simulations."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.process_noise import NoisyInputs, ProcessNoise, input_deviation
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import inputs_along, states_from, substeps_along
from obsdesign.dynamics.step import CACHE_SIZE
from obsdesign.trajectory import Trajectory


def state_noise(system: AbstractSystem, path: Trajectory, noise: ProcessNoise, white: np.ndarray) -> np.ndarray:
    """Return what is added to the states after each step of a path (N, n), without the noise of inputs; system as along the path.

    white (N, r + r'): N(0, 1) each, for the columns that are steady and for those that grow with the speed.
    """
    L, L_per_speed = noise.L, noise.L_per_speed
    drawn = white[:, : L.shape[1]] @ L.T
    if not path.is_even:
        drawn *= np.sqrt(path.lengths)[:, None]
    if not L_per_speed.size:
        return drawn
    speed = _speed_scan(system.model).along(np.empty(0), path.x[:-1], inputs_along(system, path)[0])[1]
    return drawn + np.sqrt(speed) * (white[:, L.shape[1] :] @ L_per_speed.T)


def with_input_noise(system: AbstractSystem, path: Trajectory, noise: ProcessNoise, white: np.ndarray) -> tuple[AbstractSystem, np.ndarray]:
    """Return the system whose inputs have noise, and its unknown inputs (..., N, p + r) along a path, r of them drawn white (..., N, r).

    The sizes of the noise are those at the states of the path.
    """
    u, w = inputs_along(system, path)
    if not noise.inputs:
        return system, w
    sizes = _deviation_scan(system.model, noise).along(np.empty(0), path.x[:-1], u)[1]
    drawn = white * sizes
    return NoisyInputs(system, noise.input_names), np.concatenate([np.broadcast_to(w, (*drawn.shape[:-1], w.shape[1])), drawn], axis=-1)


def input_noise_effect(system: AbstractSystem, path: Trajectory, noise: ProcessNoise, white: np.ndarray) -> np.ndarray:
    """Return by how much drawn noise of inputs (R, N, r) moves the ends of the steps of a path, each by itself (R, N, n)."""
    (runs, steps, _), n = white.shape, path.x.shape[1]
    if not noise.inputs:
        return np.zeros((runs, steps, n))
    noisy, w = with_input_noise(system, path, noise, white)
    u, substeps = np.tile(inputs_along(system, path)[0], (runs, 1))[:, None], substeps_along(system, path)
    starts, silent = np.tile(path.x[:-1], (runs, 1)), np.array(w)
    silent[..., -len(noise.inputs) :] = 0.0
    ends = [states_from(noisy, starts, u, path.pace, v.reshape(runs * steps, 1, -1), substeps=substeps)[:, 1] for v in (w, silent)]
    return (ends[0] - ends[1]).reshape(runs, steps, n)


@lru_cache(CACHE_SIZE)
def _speed_scan(model: Model) -> Scan:
    import casadi as ca

    return Scan(ca.SX(0, 1), [model.x, model.u], ca.SX(0, 1), [model.speed])


@lru_cache(CACHE_SIZE)
def _deviation_scan(model: Model, noise: ProcessNoise) -> Scan:
    import casadi as ca

    deviations = [input_deviation(model, entry.steady, entry.per_speed) for entry in noise.inputs]
    return Scan(ca.SX(0, 1), [model.x, model.u], ca.SX(0, 1), [ca.vertcat(*deviations)])
