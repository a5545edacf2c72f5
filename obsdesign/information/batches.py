"""The information of many paths at once, each simulated from a start of its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array, require_positive, require_tolerance
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import simulate, substeps_needed
from obsdesign.errors import InputError
from obsdesign.information.accumulation import simulating_accumulator
from obsdesign.information.gramian import require_sensors, variational_gramian
from obsdesign.trajectory import TOLERANCE

_PATHS_PER_TASK = 500  # paths per task: fixed, so that the answer does not depend on the number of workers


@dataclass(frozen=True, eq=False)
class _BatchTask:
    system: AbstractSystem
    starts: np.ndarray
    u: np.ndarray
    dt: float
    w: np.ndarray | None
    first: int
    tolerance: float = TOLERANCE


@validate_arguments
def batch_information(
    system: AbstractSystem | Sequence[AbstractSystem],
    starts: ArrayLike,
    u: ArrayLike,
    dt: float,
    w: ArrayLike | None = None,
    executor: Executor | None = None,
    *,
    tolerance: float = TOLERANCE,
) -> np.ndarray:
    """Return W (M, S, n, n), the variational Gramian of each sensor about each of M starts, every path simulated.

    W = sum_k Phi_k' C_k' R^-1 C_k Phi_k, as `variational_gramian` has it, for many paths at once.

    Arguments:
        system: one for all, or M systems with the same states, inputs and number of sensors, such as one system with other parameters;
            each that differs is built anew (some 20 ms): a parameter that varies from start to start is better a constant state.
        starts (M, n): initial states, in the units of the states.
        u: known inputs (N, m) for all starts or (M, N, m) for each, in their units.
        dt: length of a step [s].
        w: unknown inputs (N, p) or (M, N, p), in their units; None = 0.
        executor: any concurrent.futures.Executor of processes; the answer is the same for any number of them.
        tolerance: relative error of the steps, as in simulate.
    Raises InputError for shapes that do not fit, values that are not finite, and a path through a landmark.
    """
    require_positive("dt", dt)
    require_tolerance(tolerance)
    points = as_array("starts", starts)
    if points.ndim != 2 or not len(points):
        raise InputError(f"starts has shape {points.shape}: must be (M, n), M > 0")
    systems = [system] * len(points) if isinstance(system, AbstractSystem) else list(system)
    if len(systems) != len(points):
        raise InputError(f"starts has shape {points.shape} for {len(systems)} systems: must be (M, n), M > 0, one start for each system")
    inputs, unknown = as_array("u", u), None if w is None else as_array("w", w)
    inputs = inputs[:, None] if inputs.ndim == 1 else inputs
    sensors = {len(item.model.channels) for item in dict.fromkeys(systems)}
    if len(sensors) > 1:
        raise InputError(f"the systems have {' and '.join(map(str, sorted(sensors)))} sensors: all must have the same number")
    tasks = [replace(task, tolerance=tolerance) for task in _tasks(systems, points, inputs, dt, unknown)]
    totals = map(_totals, tasks) if executor is None else executor.map(_totals, tasks)
    return np.concatenate(list(totals))


def _tasks(systems: list[AbstractSystem], points: np.ndarray, u: np.ndarray, dt: float, w: np.ndarray | None) -> Iterator[_BatchTask]:
    """One task for each run of the same system, at most so many starts long."""
    first = 0
    for last in range(1, len(points) + 1):
        if last < len(points) and systems[last] == systems[first] and last - first < _PATHS_PER_TASK:
            continue
        task_inputs = [values[first:last] if values is not None and values.ndim == 3 else values for values in (u, w)]
        _require_shapes(systems[first], points[first:last], u, w, len(points), first)
        yield _BatchTask(systems[first], points[first:last], task_inputs[0], dt, task_inputs[1], first)  # pyright: ignore[reportArgumentType]
        first = last


def _require_shapes(system: AbstractSystem, points: np.ndarray, u: np.ndarray, w: np.ndarray | None, count: int, first: int) -> None:
    model = system.model
    require_sensors(system)
    if points.shape[1] != len(model.states):
        raise InputError(f"starts has {points.shape[1]} columns: must have {len(model.states)} for {', '.join(model.state_names)}")
    steps = u.shape[-2] if u.ndim >= 2 else 0
    for name, values, width in (("u", u, len(model.inputs)), ("w", w, len(model.unknown_inputs))):
        if values is None:
            continue
        accepted = ((steps, width), (count, steps, width))
        if steps < 1 or values.shape not in accepted:
            raise InputError(f"{name} has shape {values.shape}: must be (N, {width}) or ({count}, N, {width}), N > 0 the same for u and w")
        if not np.isfinite(values).all():
            index = np.argwhere(~np.isfinite(values))[0]
            raise InputError(f"{name}[{', '.join(map(str, index))}] is {values[tuple(index)]}: must be finite")
    if not np.isfinite(points).all():
        row, column = np.argwhere(~np.isfinite(points))[0]
        raise InputError(f"starts[{first + row}]: {model.state_names[column]} is {points[row, column]}: must be finite")


def _totals(task: _BatchTask) -> np.ndarray:
    counts = _substeps(task)
    groups = [(rows, _totals_of(task, rows, int(counts[rows[0]]))) for rows in (np.flatnonzero(counts == c) for c in np.unique(counts))]
    if len(groups) == 1:
        return groups[0][1]
    totals = np.empty((len(counts), *groups[0][1].shape[1:]))
    for rows, W in groups:
        totals[rows] = W
    return totals


def _totals_of(task: _BatchTask, rows: np.ndarray, substeps: int) -> np.ndarray:
    """Return W of the paths of these rows."""
    accumulator, steps = simulating_accumulator(task.system.model, task.dt, substeps), task.u.shape[-2]
    no_disturbance = np.zeros(len(task.system.model.unknown_inputs))
    inputs = [values[rows] if values.ndim == 3 else values for values in (task.u, no_disturbance if task.w is None else task.w)]
    start = accumulator.initial_carry(task.starts[rows])
    carry = accumulator.scan.run(start, [*inputs, *accumulator.sampling_rows(task.system, steps, task.dt)], steps, carries=False).carry
    if not np.isfinite(carry).all():
        _raise_for_start(task, int(rows[np.argwhere(~np.isfinite(carry))[0, 0]]))
    return accumulator.sums(carry)


def _substeps(task: _BatchTask) -> np.ndarray:
    """Return what each path of a task needs; raise InputError with the first start that needs too many."""
    try:
        return substeps_needed(task.system, task.starts, task.u, task.dt, task.w, task.tolerance)
    except InputError:
        for row in range(len(task.starts)):
            _raise_for_start(task, row, steps_only=True)
        raise


def _raise_for_start(task: _BatchTask, row: int, steps_only: bool = False) -> None:
    """Raise what the start of that row is refused for; steps_only: for what its steps are, or not at all."""
    u = task.u[row] if task.u.ndim == 3 else task.u
    w = task.w[row] if task.w is not None and task.w.ndim == 3 else task.w
    try:
        path = simulate(task.system, task.starts[row], u, task.dt, w, tolerance=task.tolerance)
        if steps_only:
            return
        variational_gramian(task.system, path)
    except InputError as error:
        raise InputError(f"starts[{task.first + row}]: {error}") from None
    raise InputError(f"starts[{task.first + row}]: the information is not finite")
