"""Integrals of what samples tell over each step of a path, by Simpson's rule."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import all_inputs_along, states_from, substeps_along
from obsdesign.trajectory import Trajectory

_HALVING_RATIO = 15  # change of an integral of order 4 when its pieces are halved, over what is left of its error
_MAX_PIECES = 1024  # of one step, at most


class StepSplit(NamedTuple):
    """Length of a step [s], and of how many sub-steps it is made."""

    step: float
    substeps: int


# (x (N, n), (u, w) (N, m + p), pace, weighted) -> (N, S, n, n), the information of one sample of each sensor at each step
Sampler = Callable[[np.ndarray, np.ndarray, StepSplit, bool], np.ndarray]


def step_split(system: AbstractSystem, path: Trajectory) -> StepSplit:
    """Return what the steps of a path are made of, for its tolerance."""
    return StepSplit(path.pace, substeps_along(system, path))


def integral_over_steps(system: AbstractSystem, path: Trajectory, sampler: Sampler) -> np.ndarray:
    """Return the integral over each step (N, S, n, n), by Simpson's rule over equal pieces.

    As many pieces as it takes for the path's tolerance: halves of them change less.
    """
    pieces = substeps_along(system, path)
    integral = _simpson(system, path, sampler, pieces)
    while True:
        finer = _simpson(system, path, sampler, 2 * pieces)
        totals = [values.sum(axis=0) for values in (integral, finer)]
        size = np.sqrt(np.maximum(np.diagonal(totals[1], axis1=1, axis2=2), 0.0))
        difference = np.abs(totals[1] - totals[0]) / _HALVING_RATIO
        # what is not finite is refused by whoever asked
        if not np.any(difference > path.tolerance * size[:, :, None] * size[:, None]) or pieces >= _MAX_PIECES:
            return integral
        pieces, integral = 2 * pieces, finer


def _simpson(system: AbstractSystem, path: Trajectory, sampler: Sampler, pieces: int) -> np.ndarray:
    """Return the integral over each step (N, S, n, n), on the values at start, middle and end of each piece."""
    all_inputs, half_piece = all_inputs_along(system, path), StepSplit(path.pace / (2 * pieces), min(pieces, 2))
    nodes = np.empty((path.steps, 2 * pieces, path.x.shape[1]))
    nodes[:, 0] = path.x[:-1]
    for j in range(1, 2 * pieces):
        nodes[:, j] = one_step(system, nodes[:, j - 1], all_inputs, *half_piece)
    states = np.vstack([nodes.reshape(-1, path.x.shape[1]), path.x[-1:]])
    values = sampler(states, np.vstack([np.repeat(all_inputs, 2 * pieces, axis=0), all_inputs[-1:]]), half_piece, False)
    integrals = (values[:-2:2] + 4 * values[1::2] + values[2::2]) * half_piece.step / 3
    if not path.is_even:  # of time, where steps were counted
        integrals = integrals * np.repeat(path.lengths, pieces)[:, None, None, None]
    return integrals.reshape(path.steps, pieces, *integrals.shape[1:]).sum(axis=1) if pieces > 1 else integrals


def one_step(system: AbstractSystem, x: np.ndarray, all_inputs: np.ndarray, step: float, substeps: int) -> np.ndarray:
    """Return where each of the states x (N, n) gets to in one step under its own row of inputs."""
    u, w = split_inputs(system, all_inputs[:, None])
    return states_from(system, x, u, step, w, substeps=substeps)[:, 1]


def split_inputs(system: AbstractSystem, all_inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return u (..., m) and w (..., p) of (u, w) (..., m + p)."""
    m = len(system.model.inputs)
    return all_inputs[..., :m], all_inputs[..., m:]
