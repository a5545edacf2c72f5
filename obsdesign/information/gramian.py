"""Observability Gramians along a path, from derivatives."""

from __future__ import annotations

from functools import lru_cache, partial

import casadi as ca
import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import all_finite
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.per_step import held_columns, system_along
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import all_inputs_along
from obsdesign.dynamics.step import CACHE_SIZE, blocks_of, dense_blocks, looped_step
from obsdesign.errors import InputError
from obsdesign.information.blocks import Information, with_samples
from obsdesign.information.correlated_noise import colour_of, require_coloured
from obsdesign.information.correlated_samples import CorrelatedSamples
from obsdesign.information.provenance import origin_of
from obsdesign.information.recorded_samples import RecordedSamples, recorded_samples
from obsdesign.information.sample_information import (
    require_derivatives,
    require_finite_blocks,
    samples_at,
    samples_with_colour,
    zero_unsampled,
)
from obsdesign.information.step_integral import StepSplit, integral_over_steps, step_split
from obsdesign.information.whitening import decay_between, outputs_with_colour
from obsdesign.logs.log import Log
from obsdesign.trajectory import Trajectory


@validate_arguments
def variational_gramian(system: AbstractSystem, path: Trajectory, weighted: bool = True, samples: Log | None = None) -> Information:
    """Return what the samples along a path say about its initial state, from derivatives along the path.

    W = sum_k sum_s Phi_k' C_sk' R_s^-1 C_sk Phi_k over the samples of each sensor, with Phi_{k+1} = F_k Phi_k, Phi_0 = I.
    F is taken at the inputs that moved the path, `path.w` among them, all as if known: `posterior_information` is for those
    that are not. This is Fisher information about x(t_0), inv(W) the Cramer-Rao bound.

    Arguments:
        system: vehicle and sensors.
        path: the path along which samples are taken.
        weighted: False = the integral of Phi'C'C Phi dt over each step (Simpson's rule on half steps, order 4), whatever the sensors'
            rates.
        samples: a log, of which the samples count that arrived along the path, each at its own time and in its own number; those from
            t_k to t_k+1 are in block k. None = those that the sensors' rates promise.
    Raises InputError for paths that do not fit the system and for a path through a landmark.
    """
    require_fit(system, path)
    if samples is not None:
        return _gramian_of_log(system, path, weighted, samples)
    if not weighted and system.model.period is not None:
        raise InputError("weighted is False: an integral over time is asked for; a map from one instant to the next has samples alone")
    system = system_along(system, path)
    if weighted:
        if colour_of(system.model) is not None:
            return _gramian_with_colour(system, path)
        Phi, blocks = _sensitivities(system, path.x[:-1], all_inputs_along(system, path), step_split(system, path), True)
        blocks, transition = zero_unsampled(blocks, system, path.pace), Phi[-1]
    else:
        blocks, transition = integral_over_steps(system, path, partial(_sensitivity_samples, system)), transition_matrices(system, path)[-1]
    return with_samples(
        require_finite_blocks(blocks, system, path), system.model.sensor_names, transition, None, origin_of(system, path, weighted)
    )


def _gramian_of_log(system: AbstractSystem, path: Trajectory, weighted: bool, log: Log) -> Information:
    """Phi_k' (sum of F' C' R^-1 C F) Phi_k, F from t_k to each sample before t_k+1."""
    if not weighted:
        raise InputError("weighted is False with samples of a log: an integral over time asks for no samples")
    arrived = recorded_samples(system, path, log, has_timed_errors=True)
    along = system_along(system, path, is_sampling_given=True, has_timed_errors=True)
    Phi = transition_matrices(along, path)
    blocks = Phi[:-1, None].swapaxes(2, 3) @ arrived.local_blocks @ Phi[:-1, None]
    samples = None if colour_of(system.model) is None else _coloured_samples_of_log(arrived)
    return with_samples(require_finite_blocks(blocks, along, path), system.model.sensor_names, Phi[-1], samples, None)


def _coloured_samples_of_log(arrived: RecordedSamples) -> CorrelatedSamples:
    """Return the samples of the sensors whose errors are not independent, each at its own time."""
    events, system, n = arrived.event_path, arrived.system, arrived.path.x.shape[1]
    colour, (_, rows, level, gate) = require_coloured(system.model), _walk_with_colour(system, events.path)[1]
    sampling = (events.weights > 0)[:, colour.sensor_of_output]
    values = rows.reshape(len(sampling), colour.q, n), level, gate
    if not all_finite(np.where(sampling[..., None], values[0], 0.0)):
        require_derivatives(system, events.path, events.weights > 0)
    decay = _decay_scan(system.model).along(np.empty(0), all_inputs_along(system, events.path))[1]
    return samples_at(colour, values, sampling, events.step, arrived.path.steps, decay=decay)


@lru_cache(CACHE_SIZE)
def _decay_scan(model: Model) -> Scan:
    """(u, w) of a step -> what it leaves of the errors of coloured outputs (q,)."""
    inputs = ca.vertcat(model.u, model.w)
    return Scan(ca.SX(0, 1), [inputs], ca.SX(0, 1), [ca.densify(decay_between(model, require_coloured(model)))])


def _gramian_with_colour(system: AbstractSystem, path: Trajectory) -> Information:
    """The same with the samples of the sensors whose errors are not independent."""
    n, colour = path.x.shape[1], require_coloured(system.model)
    transition, (blocks, rows, level, gate) = _walk_with_colour(system, path)
    blocks = zero_unsampled(blocks.reshape(path.steps, -1, n, n), system, path.pace)
    blocks = require_finite_blocks(blocks, system, path)
    samples = samples_with_colour(system, colour, rows.reshape(path.steps, colour.q, n), level, gate, path.pace)
    return with_samples(blocks, system.model.sensor_names, transition, samples, origin_of(system, path))


def _walk_with_colour(system: AbstractSystem, path: Trajectory) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Return Phi (n, n) at the end, and the results of `_sensitivity_scan_with_colour` at each step (N, .)."""
    split = step_split(system, path)
    sensitivity = looped_step(system.model, *split).sensitivity
    rows = [path.x[:-1], all_inputs_along(system, path)]
    run = _sensitivity_scan_with_colour(system.model, *split).run(sensitivity.start[None], rows, path.steps, carries=False)
    return sensitivity.full(run.carry)[-1], tuple(values[0] for values in run.results)


def require_fit(system: AbstractSystem, path: Trajectory) -> None:
    """Raise InputError unless the path has this system's states and inputs, known and unknown, and the system has sensors."""
    model = system.model
    if path.x.shape[1] != len(model.states) or path.u.shape[1] != len(model.inputs) - model.is_per_step - len(held_columns(model)):
        raise InputError(
            f"path has {path.x.shape[1]} states and {path.u.shape[1]} inputs: the system has"
            f" {len(model.states)} ({', '.join(model.state_names)}) and {len(model.inputs)} ({', '.join(model.input_names)})"
        )
    if path.w is not None and path.w.shape[1] != len(model.unknown_inputs):
        names = ", ".join(signal.name for signal in model.unknown_inputs) or "none"
        raise InputError(f"path has {path.w.shape[1]} unknown inputs: the system has {len(model.unknown_inputs)} ({names})")
    require_sensors(system)


def require_sensors(system: AbstractSystem) -> None:
    """Raise InputError for a system without sensors."""
    if not system.model.channels:
        raise InputError("the system has no sensors: there is no information along any path")


def transition_matrices(system: AbstractSystem, path: Trajectory) -> np.ndarray:
    """Return Phi (N+1, n, n): Phi[k] = dx(t_k)/dx(t_0) along the path."""
    split = step_split(system, path)
    sensitivity = looped_step(system.model, *split).sensitivity
    entries = _transition_scan(system.model, *split).along(sensitivity.start, path.x[:-1], all_inputs_along(system, path))[0]
    if not all_finite(entries):
        k = int(np.argwhere(~np.isfinite(entries))[0, 0])
        raise InputError(f"dx(t_k)/dx(t_0) is not finite from step {k + 1} (t = {path.t[k + 1]:g} s) on: the system is too unstable")
    return sensitivity.full(np.vstack([sensitivity.start, entries]))


@lru_cache(CACHE_SIZE)
def _transition_scan(model: Model, step: float, substeps: int) -> Scan:
    """Phi -> F(x, u, w) Phi, without the blocks."""
    step_graph = looped_step(model, step, substeps)
    sensitivity = step_graph.sensitivity
    return Scan(sensitivity.free, [step_graph.x, step_graph.all_inputs], sensitivity.free_next, loop=step_graph.loop)


@lru_cache(CACHE_SIZE)
def sensitivity_scan(model: Model, step: float, weighted: bool, substeps: int = 1) -> Scan:
    """Phi -> F(x, u, w) Phi, with the blocks (S n n,) of a sample at x."""
    step_graph = looped_step(model, step, substeps)
    sensitivity = step_graph.sensitivity
    return Scan(
        sensitivity.free,
        [step_graph.x, step_graph.all_inputs],
        sensitivity.free_next,
        [dense_blocks(blocks_of(model, sensitivity.Phi, weighted))],
        loop=step_graph.loop,
    )


@lru_cache(CACHE_SIZE)
def _sensitivity_scan_with_colour(model: Model, step: float, substeps: int) -> Scan:
    """The same with the rows (q n), level (q,) and gate (q,) of the outputs whose errors are not independent."""
    step_graph = looped_step(model, step, substeps)
    sensitivity = step_graph.sensitivity
    outputs = outputs_with_colour(model, require_coloured(model), sensitivity.Phi)
    results = [dense_blocks(blocks_of(model, sensitivity.Phi)), ca.vec(ca.densify(outputs.rows).T), outputs.level, outputs.gate]
    return Scan(sensitivity.free, [step_graph.x, step_graph.all_inputs], sensitivity.free_next, results, loop=step_graph.loop)


def _sensitivities(
    system: AbstractSystem, x: np.ndarray, all_inputs: np.ndarray, split: StepSplit, weighted: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return Phi (1, n, n) after the last step, and blocks (N, S, n, n)."""
    sensitivity, n = looped_step(system.model, *split).sensitivity, x.shape[1]
    run = sensitivity_scan(system.model, split.step, weighted, split.substeps).run(
        sensitivity.start[None], [x, all_inputs], len(x), carries=False
    )
    return sensitivity.full(run.carry), run.results[0].reshape(len(x), -1, n, n)


def _sensitivity_samples(system: AbstractSystem, x: np.ndarray, all_inputs: np.ndarray, split: StepSplit, weighted: bool) -> np.ndarray:
    return _sensitivities(system, x, all_inputs, split, weighted)[1]
