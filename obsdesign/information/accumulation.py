"""Information summed while walking: memory does not grow with the number of steps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array, require_divisor, require_positive, require_tolerance
from obsdesign.dynamics.inner_loop import InnerLoop
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.per_step import system_along
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import all_inputs_along, simulate, substeps_along, substeps_needed
from obsdesign.dynamics.step import CACHE_SIZE, looped_step, step_of, steps_per_sample
from obsdesign.errors import InputError
from obsdesign.information.additive_amounts import additive_factors
from obsdesign.information.correlated_noise import Colour, colour_of
from obsdesign.information.gramian import require_fit, require_sensors, variational_gramian
from obsdesign.information.sample_graph import instant_of
from obsdesign.information.sample_information import sampling_mask
from obsdesign.packing import Packing, packing_of
from obsdesign.trajectory import TOLERANCE, Trajectory

_PATHS_PER_TASK = 500  # paths per task: fixed, so that the answer does not depend on the number of workers


@dataclass(frozen=True, eq=False)
class Accumulator:
    """(x, Phi, errors, W) -> one step later, W the packed sums over the samples of each sensor; rows u, w and those of `taken`.

    start: of Phi and of what is remembered of errors that are not independent, at the beginning of a path; see `InformationStep`.
    """

    scan: Scan
    start: np.ndarray
    packing: Packing
    is_masked: bool
    colour: Colour | None

    def initial_carry(self, x: np.ndarray) -> np.ndarray:
        """Return the carry (M, c) at starts x (M, n)."""
        n, moving = x.shape[1], x.shape[1] + len(self.start)
        carry = np.zeros((len(x), moving + len(self.packing.rows)))
        carry[:, :n], carry[:, n:moving] = x, self.start
        return carry

    def sampling_rows(self, system: AbstractSystem, steps: int, step: float, weights: np.ndarray | None = None) -> list[np.ndarray]:
        """Return the rows that say which samples there are: none where every sensor has one at every step.

        weights (N, S): which of them count, where errors are not independent; None = all.
        """
        if not self.is_masked:
            return []
        sampling = sampling_mask(system, steps, step).astype(float)
        if self.colour is None:
            return [sampling]
        return [sampling, np.ones_like(sampling) if weights is None else weights]

    def sums(self, carry: np.ndarray) -> np.ndarray:
        """Return W (M, S, n, n) of carries (M, c)."""
        return self.packing.full(carry[:, carry.shape[1] - len(self.packing.rows) :])


@dataclass(frozen=True, eq=False)
class InformationStep:
    """One step as SX: state x, carry (Phi's free entries, and what is remembered of errors that are not independent), inputs u, w and
    both, `sampling` = who samples, and the blocks that are sampled, as `Instant` has them; start: of the carry.
    """

    x: ca.SX
    carry: ca.SX
    u: ca.SX
    w: ca.SX
    all_inputs: ca.SX
    sampling: list[ca.SX]
    x_next: ca.SX
    carry_next: ca.SX
    blocks: list[ca.SX]
    start: np.ndarray
    loop: InnerLoop | None


@lru_cache(CACHE_SIZE)
def information_step(
    model: Model, step: float, substeps: int = 1, is_additive: bool = False, has_derivatives: bool = False
) -> InformationStep:
    """Return one step with its samples: the blocks of independent errors, or what each sensor adds to the samples before and beside.

    is_additive: amounts from below instead of the latter, of each sensor alone; has_derivatives: sub-steps as one graph, not as a loop.
    """
    step_graph = (step_of if has_derivatives else looped_step)(model, step, substeps)
    sensitivity = step_graph.sensitivity
    instant = instant_of(model, sensitivity.Phi, any(period > 1 for period in steps_per_sample(model, step)), is_additive)
    carry, carry_next = ca.vertcat(sensitivity.free, instant.carry), ca.vertcat(sensitivity.free_next, instant.carry_next)
    start = np.concatenate([sensitivity.start, instant.start])
    return InformationStep(
        step_graph.x,
        carry,
        step_graph.u,
        step_graph.w,
        step_graph.all_inputs,
        instant.sampling,
        step_graph.x_next,
        carry_next,
        instant.blocks,
        start,
        step_graph.loop,
    )


@lru_cache(CACHE_SIZE)
def simulating_accumulator(model: Model, step: float, substeps: int = 1) -> Accumulator:
    """Return the walk that simulates as it sums."""
    step_graph = information_step(model, step, substeps)
    packing, sums, sums_next = _running_sums(step_graph)
    scan = Scan(
        ca.vertcat(step_graph.x, step_graph.carry, sums),
        [step_graph.u, step_graph.w, *step_graph.sampling],
        ca.vertcat(step_graph.x_next, step_graph.carry_next, sums_next),
        loop=step_graph.loop,
    )
    return Accumulator(scan, step_graph.start, packing, bool(step_graph.sampling), colour_of(model))


@lru_cache(CACHE_SIZE)
def accumulator_along(model: Model, step: float, substeps: int = 1, is_additive: bool = False) -> Accumulator:
    """The same along given states: (Phi, errors, W), rows x, (u, w) and who samples."""
    step_graph = information_step(model, step, substeps, is_additive)
    packing, sums, sums_next = _running_sums(step_graph)
    scan = Scan(
        ca.vertcat(step_graph.carry, sums),
        [step_graph.x, step_graph.all_inputs, *step_graph.sampling],
        ca.vertcat(step_graph.carry_next, sums_next),
        loop=step_graph.loop,
    )
    return Accumulator(scan, step_graph.start, packing, bool(step_graph.sampling), colour_of(model))


def _running_sums(step_graph: InformationStep) -> tuple[Packing, ca.SX, ca.SX]:
    packing = packing_of(step_graph.blocks)
    sums = ca.SX.sym("W", len(packing.rows))
    return packing, sums, sums + packing.column(step_graph.blocks)


@validate_arguments
def segment_information(system: AbstractSystem, path: Trajectory, segments: int) -> np.ndarray:
    """Return (K, S, n, n), the information of each segment and sensor, in memory that does not grow with the steps.

    It is `variational_gramian(system, path).by_segment(K)`: block [k, s] is the information about x(t_0) of the samples of sensor s in
    the k-th of K equal groups of steps; of sensors whose errors are not independent an amount from below for every schedule,
    `path_information` the exact value.

    Arguments:
        system: vehicle and sensors.
        path: the path along which samples are taken.
        segments: number K of segments, which divides the number of steps.
    Raises InputError as variational_gramian, and unless K divides the number of steps.
    """
    require_fit(system, path)
    system = system_along(system, path)
    require_divisor("segments", segments, "steps", path.steps)
    accumulator = accumulator_along(system.model, path.pace, substeps_along(system, path), is_additive=colour_of(system.model) is not None)
    length = path.steps // segments
    rows = [path.x[:-1], all_inputs_along(system, path), *accumulator.sampling_rows(system, path.steps, path.pace)]
    if accumulator.colour is not None:
        firsts = np.arange(0, path.steps, length)
        rows += additive_factors(accumulator.colour, rows[2][:, accumulator.colour.sensor_of_output] > 0, firsts).rows(firsts)
    return accumulator.packing.full(np.array(_sums_by_stretch(accumulator, system, path, rows, length)))


def path_information(system: AbstractSystem, path: Trajectory, weights: np.ndarray | None = None) -> np.ndarray:
    """Return W (n, n), what all samples along a path say about x(t_0), in memory that does not grow with the steps.

    weights (K, S): how much the samples of each sensor count in each of K equal groups of steps, None = all of them, once; where
    errors are not independent the share of them that arrives, 0 to 1.
    Raises InputError as variational_gramian.
    """
    if colour_of(system.model) is None:
        if weights is None:
            return segment_information(system, path, 1)[0].sum(axis=0)
        return np.einsum("ks,ksij->ij", weights, segment_information(system, path, len(weights)))
    require_fit(system, path)
    system = system_along(system, path)
    accumulator = accumulator_along(system.model, path.pace, substeps_along(system, path))
    share = None if weights is None else np.repeat(weights, path.steps // len(weights), axis=0)
    rows = [path.x[:-1], all_inputs_along(system, path), *accumulator.sampling_rows(system, path.steps, path.pace, share)]
    return accumulator.packing.full(np.array(_sums_by_stretch(accumulator, system, path, rows, path.steps)))[0].sum(axis=0)


def _sums_by_stretch(
    accumulator: Accumulator, system: AbstractSystem, path: Trajectory, rows: list[np.ndarray], length: int
) -> list[np.ndarray]:
    """Return the packed sums of each stretch of so many steps."""
    carried, sums = accumulator.start, []
    for first in range(0, path.steps, length):
        rows_of_stretch = [values[first : first + length] for values in rows]
        carry = accumulator.scan.last(np.concatenate([carried, np.zeros(len(accumulator.packing.rows))]), *rows_of_stretch)
        if not np.isfinite(carry).all():
            variational_gramian(system, path.part(0, first + length))
        sums.append(carry[len(carried) :])
        carried = carry[: len(carried)]
    return sums


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
