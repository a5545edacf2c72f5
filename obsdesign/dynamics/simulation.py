"""From inputs to a path."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import all_finite, as_array, require_positive, require_tolerance
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.per_step import PerStepSystem, scaled_inputs
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.step import CACHE_SIZE, looped_step
from obsdesign.dynamics.step_comparison import PathBatch
from obsdesign.dynamics.substeps import substeps_for, substeps_from
from obsdesign.errors import InputError
from obsdesign.trajectory import TOLERANCE, Trajectory, even_path_of, path_of


@validate_arguments
def simulate(
    system: AbstractSystem, x0: ArrayLike, u: ArrayLike, dt: ArrayLike, w: ArrayLike | None = None, *, tolerance: float = TOLERANCE
) -> Trajectory:
    """Integrate xdot = g0 + f u + g w by RK4 with inputs held over each step.

    Headings stay continuous. Each step is made of as many sub-steps as it takes for states and sensitivities to have a relative error below
    the tolerance; of an exact one where rates are linear with constant coefficients.

    Arguments:
        system: what moves.
        x0 (n,): initial state, in the units of the states.
        u (N, m): known inputs, in their units.
        dt: length of a step [s], or (N,) those of all steps, of which each may be another.
        w (N, p): unknown inputs, in their units, which the path keeps; None = 0.
        tolerance: relative error of the steps, in (0, 1), which the path keeps too.
    Raises InputError for wrong shapes, values that are not finite, and a step too coarse for the dynamics, with one that would do.
    """
    lengths = as_lengths(dt)
    require_tolerance(tolerance)
    start = as_state(system, x0, "x0")
    u_known, w_unknown = as_input_arrays(system, u, w)
    t = times_of(lengths, len(u_known))
    make = path_of if lengths.ndim else even_path_of
    path = make(t, np.zeros((len(t), len(start))), u_known, None if w is None else w_unknown, tolerance)
    along = system if path.is_even else PerStepSystem(system)
    u_rows, w_rows = inputs_along(along, path)
    substeps = int(substeps_needed(along, start[None], u_rows, path.pace, w_rows, tolerance)[0])
    states = states_from(along, start[None], u_rows, path.pace, w_rows, substeps=substeps)[0]
    if not all_finite(states):
        k, i = np.argwhere(~np.isfinite(states))[0]
        name = system.model.state_names[i]
        where = f"from step {k} (t = {t[k]:g} s) on"
        raise InputError(f"{name} is {states[k, i]} {where}: the motion runs away, only a shorter path would do")
    path = make(t, states, u_known, path.w, tolerance)
    path.substeps[along.model] = substeps
    return path


def as_lengths(dt: ArrayLike) -> np.ndarray:
    """Return the lengths () or (N,) of steps [s]; raise InputError unless all are finite numbers above 0."""
    lengths = as_array("dt", dt)
    for k, length in enumerate(lengths.ravel().tolist()):
        require_positive(f"dt[{k}]" if lengths.ndim else "dt", length)
    return lengths


def times_of(lengths: np.ndarray, steps: int) -> np.ndarray:
    """Return the instants (N+1,) of N steps of lengths () or (N,) [s] from 0 on; raise InputError for another number of them."""
    if lengths.shape not in {(), (steps,)}:
        raise InputError(f"dt has shape {lengths.shape}: must be one number or ({steps},), one for each row of u")
    with np.errstate(over="ignore"):
        t = np.arange(steps + 1) * float(lengths) if lengths.ndim == 0 else np.append(0.0, np.cumsum(lengths))
    require_positive("dt times the number of steps", float(t[-1]))
    return t


def substeps_needed(
    system: AbstractSystem, starts: np.ndarray, u: np.ndarray, dt: float, w: np.ndarray | None = None, tolerance: float = TOLERANCE
) -> np.ndarray:
    """Return how many sub-steps (M,) the paths from starts (M, n) need; u and w as in `states_from`.

    Raises InputError where that would be too many, with the step that would do.
    """
    model = system.model
    counts = substeps_from(model, starts, u, w, dt, tolerance)
    if counts is not None:
        return counts
    all_inputs = _stack_inputs(u, np.zeros((1, len(model.unknown_inputs))) if w is None else w)
    return substeps_for(PathBatch(model, dt, all_inputs, starts), tolerance)


def substeps_along(system: AbstractSystem, path: Trajectory) -> int:
    """Return how many sub-steps each step along a path needs for its tolerance, states as they are: found out once for each path.

    Raises InputError where that would be too many.
    """
    model = system.model
    if model not in path.substeps:
        counts = substeps_from(model, path.x[:1], *inputs_along(system, path), path.pace, path.tolerance)
        if counts is None:
            counts = substeps_for(PathBatch(model, path.pace, all_inputs_along(system, path), path.x[None, :-1]), path.tolerance)
        path.substeps[model] = int(counts[0])
    return path.substeps[model]


def states_from(
    system: AbstractSystem,
    starts: np.ndarray,
    u: np.ndarray,
    dt: float,
    w: np.ndarray | None = None,
    increments: np.ndarray | None = None,
    *,
    substeps: int = 1,
) -> np.ndarray:
    """Return the states (M, N+1, n) of M paths from starts (M, n), each step made of so many sub-steps.

    u (N, m) or (M, N, m), w (N, p), (M, N, p) or None = 0; increments (M, N, n) or None: added to the state after each step.
    """
    rows = [u, np.zeros(len(system.model.unknown_inputs)) if w is None else w, *(() if increments is None else (increments,))]
    states = _state_scan(system.model, dt, increments is not None, substeps).run(starts, rows, u.shape[-2]).carries
    return np.concatenate([starts[:, None], states], axis=1)


@lru_cache(CACHE_SIZE)
def _state_scan(model: Model, dt: float, has_increments: bool, substeps: int) -> Scan:
    import casadi as ca

    step_graph, increment = looped_step(model, dt, substeps), ca.SX.sym("kick", len(model.states))
    rows, x_next = [step_graph.u, step_graph.w], step_graph.x_next
    if has_increments:
        rows, x_next = [*rows, increment], x_next + increment
    return Scan(step_graph.x, rows, x_next, loop=step_graph.loop)


@dataclass(frozen=True, eq=False)
class Readings:
    """Noise-free outputs y (M, N, q) at states, with what their noise is there.

    spread (M, N, q): its standard deviation; variance (M, N, q): what filters and information count for it; gate (M, N, q):
    share of the samples that arrive.
    """

    y: np.ndarray
    spread: np.ndarray
    variance: np.ndarray
    gate: np.ndarray


def readings(system: AbstractSystem, states: np.ndarray, u: np.ndarray | None = None) -> Readings:
    """Return what the sensors read at states (M, N, n) under inputs u (N, m); None: only of outputs that contain none."""
    model = system.model
    if u is None:
        require_free_outputs(model, "samples apart from a path, as of `calibrate` and `fly`,")
        u = np.zeros((states.shape[1], len(model.inputs)))
    return Readings(*_readings_scan(model).run(np.empty((len(states), 0)), [states, u], states.shape[1], carries=False).results)


def require_free_outputs(model: Model, what: str) -> None:
    """Raise InputError where an output contains a known input."""
    if places := model.inputs_in_outputs:
        name = model.input_names[places[0]]
        raise InputError(f"outputs contain the input {name!r}: {what} need outputs without inputs")


@lru_cache(CACHE_SIZE)
def _readings_scan(model: Model) -> Scan:
    import casadi as ca

    noises = [(channel.noise, len(channel.outputs)) for channel in model.channels]
    columns = [
        ca.vertcat(*[ca.SX.ones(count) * value(noise) for noise, count in noises])
        for value in (lambda noise: noise.spread, lambda noise: noise.variance, lambda noise: noise.gate)
    ]
    return Scan(ca.SX(0, 1), [model.x, model.u], ca.SX(0, 1), [model.h, *columns])


def as_state(system: AbstractSystem, value: ArrayLike, what: str) -> np.ndarray:
    """Return value as a finite (n,) array or raise InputError naming the first entry that is wrong."""
    state = as_array(what, value)
    names = system.model.states
    if state.shape != (len(names),):
        names = system.model.state_names
        raise InputError(f"{what} has shape {state.shape}: must be ({len(names)},) for {', '.join(names)}")
    if not all_finite(state):
        first = int(np.flatnonzero(~np.isfinite(state))[0])
        raise InputError(f"{what}: {names[first].name} is {state[first]}: must be finite")
    return state


def as_scale(system: AbstractSystem, value: ArrayLike | None) -> np.ndarray:
    """Return what counts as one unit of each state (n,), None = ones, or raise InputError naming the first that is not above 0."""
    if value is None:
        return np.ones(len(system.model.states))
    scale = as_state(system, value, "scale")
    for name, unit in zip(system.model.state_names, scale, strict=True):
        require_positive(f"scale of {name}", float(unit))
    return scale


def all_inputs_along(system: AbstractSystem, path: Trajectory) -> np.ndarray:
    """Return (u, w) (N, m + p) along a path of this system, w = 0 where the path does not tell it."""
    return join_inputs(*inputs_along(system, path))


def inputs_along(system: AbstractSystem, path: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Return u (N, m) and w (N, p) along a path of this system, w = 0 where the path does not tell it."""
    p = len(system.model.unknown_inputs)
    if system.model.is_per_step:
        return scaled_inputs(path, system.model)
    return path.u, np.zeros((path.steps, p)) if path.w is None else path.w


def _stack_inputs(u: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return (u, w) (N, m + p), or (M, N, m + p) where one of them is of each path its own."""
    shape = np.broadcast_shapes(u.shape[:-1], w.shape[:-1])
    return np.concatenate([np.broadcast_to(values, (*shape, values.shape[-1])) for values in (u, w)], axis=-1)


def join_inputs(u: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return (u, w) (N, m + p), u itself where nothing is unknown."""
    return np.hstack([u, w]) if w.shape[1] else u


def as_input_arrays(system: AbstractSystem, u: ArrayLike, w: ArrayLike | None) -> tuple[np.ndarray, np.ndarray]:
    """Return u (N, m) and w (N, p), None = 0, or raise InputError unless both have the same number of steps, at least 1."""
    model = system.model
    u_known = as_inputs(u, len(model.inputs), "u")
    steps = len(u_known)
    w_unknown = np.zeros((steps, len(model.unknown_inputs))) if w is None else as_inputs(w, len(model.unknown_inputs), "w")
    if steps < 1 or len(w_unknown) != steps:
        raise InputError(f"u has {steps} steps and w {len(w_unknown)}: both need the same number, at least 1")
    return u_known, w_unknown


def as_inputs(value: ArrayLike, width: int, what: str) -> np.ndarray:
    """Return value as a finite (N, width) array; (N,) is accepted where width is 1."""
    inputs = as_array(what, value)
    if inputs.ndim == 1 and width == 1:
        inputs = inputs[:, None]
    if inputs.ndim != 2 or inputs.shape[1] != width:
        raise InputError(f"{what} has shape {inputs.shape}: must be (N, {width})")
    if not all_finite(inputs):
        row, column = np.argwhere(~np.isfinite(inputs))[0]
        raise InputError(f"{what}[{row}, {column}] is {inputs[row, column]}: must be finite")
    return inputs
