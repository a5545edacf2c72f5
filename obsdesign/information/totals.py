"""Information summed while walking: memory does not grow with the number of steps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import as_array, require_divisor, require_positive
from obsdesign.errors import InputError
from obsdesign.information.gramian import require_fit, require_sensors, variational_gramian
from obsdesign.information.sampling import sampled
from obsdesign.model import AbstractSystem, Model
from obsdesign.packing import Packing, packing_of
from obsdesign.scan import Scan
from obsdesign.simulation import held_along, simulate
from obsdesign.step import CACHED, Sensitivity, blocks_of, sensitivity_along, step_of, steps_per_sample
from obsdesign.trajectory import Trajectory

_CHUNK = 500  # paths per task: fixed, so that the answer does not depend on the number of workers


@dataclass(frozen=True, eq=False)
class Walk:
    """(x, Phi, W) -> one step later, W the packed sums over the samples of each sensor; rows u, w and, if masked, who samples."""

    scan: Scan
    shape: Sensitivity
    packing: Packing
    masked: bool

    def first(self, x: np.ndarray) -> np.ndarray:
        """Return the carry (M, c) at starts x (M, n)."""
        rest = np.concatenate([self.shape.start, np.zeros(len(self.packing.rows))])
        return np.hstack([x, np.tile(rest, (len(x), 1))])

    def sums(self, carry: np.ndarray) -> np.ndarray:
        """Return W (M, S, n, n) of carries (M, c)."""
        return self.packing.full(carry[:, carry.shape[1] - len(self.packing.rows) :])


@dataclass(frozen=True, eq=False)
class Stepped:
    """One step as SX: state (x, Phi's free entries), inputs u, w and both, `due` (S,) or nothing, and the blocks that are sampled."""

    x: ca.SX
    Phi: ca.SX
    u: ca.SX
    w: ca.SX
    held: ca.SX
    due: list[ca.SX]
    x_next: ca.SX
    Phi_next: ca.SX
    blocks: list[ca.SX]


@lru_cache(CACHED)
def stepped(model: Model, step: float) -> Stepped:
    """Return one step with its samples; `due` is there only if a sensor is slower than the steps."""
    one, shape = step_of(model, step), sensitivity_along(model, step)
    blocks, due = blocks_of(model, shape.Phi), []
    if any(period > 1 for period in steps_per_sample(model, step)):
        due = [ca.SX.sym("due", len(blocks))]
        # not a product: where a sensor has no derivative and no sample, nothing is lost
        blocks = [ca.if_else(due[0][s], block, ca.SX(*block.shape)) for s, block in enumerate(blocks)]
    return Stepped(one.x, shape.free, one.u, one.w, one.held, due, one.x_next, shape.next, blocks)


@lru_cache(CACHED)
def walk_of(model: Model, step: float) -> Walk:
    """Return the walk that simulates as it sums."""
    one, shape = stepped(model, step), sensitivity_along(model, step)
    packing, sums, sums_next = _summed(one)
    carry_next = ca.vertcat(one.x_next, one.Phi_next, sums_next)
    return Walk(Scan(ca.vertcat(one.x, one.Phi, sums), [one.u, one.w, *one.due], carry_next), shape, packing, bool(one.due))


@lru_cache(CACHED)
def _along(model: Model, step: float) -> Walk:
    """The same along given states: (Phi, W), rows x, (u, w) and, if masked, who samples."""
    one, shape = stepped(model, step), sensitivity_along(model, step)
    packing, sums, sums_next = _summed(one)
    scan = Scan(ca.vertcat(one.Phi, sums), [one.x, one.held, *one.due], ca.vertcat(one.Phi_next, sums_next))
    return Walk(scan, shape, packing, bool(one.due))


def _summed(one: Stepped) -> tuple[Packing, ca.SX, ca.SX]:
    packing = packing_of(one.blocks)
    sums = ca.SX.sym("W", len(packing.rows))
    return packing, sums, sums + packing.column(one.blocks)


def segment_information(system: AbstractSystem, path: Trajectory, segments: int) -> np.ndarray:
    """Return (K, S, n, n): what `variational_gramian(system, path).by_segment(K)` is, in memory that does not grow with the steps.

    Block [k, s] is the information about x(t_0) of the samples of sensor s in the k-th of K equal groups of steps.
    Raises InputError as variational_gramian, and unless K divides the number of steps.
    """
    require_fit(system, path)
    require_divisor("segments", segments, "steps", path.steps)
    walk, length, rows = _along(system.model, path.step), path.steps // segments, (path.x, held_along(system, path))
    Phi, sums = walk.shape.start, []
    for first in range(0, path.steps, length):
        part = [values[first : first + length] for values in rows]
        carry = np.concatenate([Phi, np.zeros(len(walk.packing.rows))])
        carry = walk.scan.last(carry, *part, *_due(walk, system, length, path.step, first))
        if not np.isfinite(carry).all():
            variational_gramian(system, path.part(0, first + length))
        sums.append(carry[len(Phi) :])
        Phi = carry[: len(Phi)]
    return walk.packing.full(np.array(sums))


def _due(walk: Walk, system: AbstractSystem, steps: int, step: float, first: int = 0) -> list[np.ndarray]:
    return [sampled(system, steps, step, first).astype(float)] if walk.masked else []


@dataclass(frozen=True, eq=False)
class _Task:
    system: AbstractSystem
    starts: np.ndarray
    u: np.ndarray
    dt: float
    w: np.ndarray | None
    first: int


def batch_information(
    system: AbstractSystem | Sequence[AbstractSystem],
    starts: ArrayLike,
    u: ArrayLike,
    dt: float,
    w: ArrayLike | None = None,
    executor: Executor | None = None,
) -> np.ndarray:
    """Return W (M, S, n, n), the variational Gramian of each sensor about each of M starts (M, n), every path simulated.

    u (N, m) for all or (M, N, m) for each; w (N, p), (M, N, p) or None = 0, unknown inputs. system: one for all, or M systems
    with the same states, inputs and number of sensors, such as one system with other parameters; each that differs is built anew
    (some 20 ms), so a parameter that varies from start to start is better a state that stays constant. executor: any
    concurrent.futures.Executor of processes; the answer is the same for any number of them.
    Raises InputError for shapes that do not fit, values that are not finite, and a path through a landmark.
    """
    require_positive("dt", dt)
    points = as_array("starts", starts)
    systems = [system] * len(points) if isinstance(system, AbstractSystem) else list(system)
    if points.ndim != 2 or not len(points) or len(systems) != len(points):
        raise InputError(f"starts has shape {points.shape} for {len(systems)} systems: must be (M, n), M > 0, one start for each system")
    inputs, unknown = as_array("u", u), None if w is None else as_array("w", w)
    inputs = inputs[:, None] if inputs.ndim == 1 else inputs
    sensors = {len(each.model.channels) for each in dict.fromkeys(systems)}
    if len(sensors) > 1:
        raise InputError(f"the systems have {' and '.join(map(str, sorted(sensors)))} sensors: all must have the same number")
    tasks = list(_tasks(systems, points, inputs, dt, unknown))
    found = map(_totals, tasks) if executor is None else executor.map(_totals, tasks)
    return np.concatenate(list(found))


def _tasks(systems: list[AbstractSystem], points: np.ndarray, u: np.ndarray, dt: float, w: np.ndarray | None) -> Iterator[_Task]:
    """One task for each run of the same system, at most so many starts long."""
    first = 0
    for last in range(1, len(points) + 1):
        if last < len(points) and systems[last] == systems[first] and last - first < _CHUNK:
            continue
        own = [values[first:last] if values is not None and values.ndim == 3 else values for values in (u, w)]
        _require_shapes(systems[first], points[first:last], u, w, len(points), first)
        yield _Task(systems[first], points[first:last], own[0], dt, own[1], first)  # pyright: ignore[reportArgumentType]
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
            place = np.argwhere(~np.isfinite(values))[0]
            raise InputError(f"{name}[{', '.join(map(str, place))}] is {values[tuple(place)]}: must be finite")
    if not np.isfinite(points).all():
        row, column = np.argwhere(~np.isfinite(points))[0]
        raise InputError(f"starts[{first + row}]: {model.state_names[column]} is {points[row, column]}: must be finite")


def _totals(task: _Task) -> np.ndarray:
    walk, steps = walk_of(task.system.model, task.dt), task.u.shape[-2]
    idle = np.zeros(len(task.system.model.unknown_inputs))
    rows = [task.u, idle if task.w is None else task.w, *_due(walk, task.system, steps, task.dt)]
    carry = walk.scan.run(walk.first(task.starts), rows, steps, carries=False).carry
    if not np.isfinite(carry).all():
        _refuse(task, int(np.argwhere(~np.isfinite(carry))[0, 0]))
    return walk.sums(carry)


def _refuse(task: _Task, row: int) -> None:
    """Raise what the start of that row is refused for."""
    u = task.u[row] if task.u.ndim == 3 else task.u
    w = task.w[row] if task.w is not None and task.w.ndim == 3 else task.w
    try:
        variational_gramian(task.system, simulate(task.system, task.starts[row], u, task.dt, w))
    except InputError as error:
        raise InputError(f"starts[{task.first + row}]: {error}") from None
    raise InputError(f"starts[{task.first + row}]: the information is not finite")
