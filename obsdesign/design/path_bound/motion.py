"""Which motions a problem allows, as pieces of a path through air or water: what the relaxation knows of vehicle, family and limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.constraints.goal import Goal
from obsdesign.constraints.goal_pose import GoalPose
from obsdesign.design.path_bound.arcs import LARGEST_HALF_TURN, Arcs, arcs_of
from obsdesign.design.problem import DesignProblem
from obsdesign.dynamics.system import System
from obsdesign.errors import InputError
from obsdesign.paths.b_spline import BSpline
from obsdesign.paths.dubins_path import DubinsPath
from obsdesign.paths.piecewise_constant import PiecewiseConstant, piece_lengths
from obsdesign.vehicles.dubins import Dubins
from obsdesign.vehicles.omnidirectional import Omnidirectional
from obsdesign.vehicles.unicycle import Unicycle

_FINE_HALF_TURN, _FEW_PIECES = 0.35, 72  # [rad]: pieces that turn by more are taken apart while there are no more than so many
_SLACK = 1e-5  # of a limit's size, by which paths may miss it and still count as keeping it


@dataclass(frozen=True, eq=False)
class End:
    """Where a path has to end: within `radius` of `point` (2,) [m], relative to the start and without the wind."""

    point: np.ndarray
    radius: float


@dataclass(frozen=True, eq=False)
class AllowedMotion:
    """Displacements through air or water in K pieces of whole steps, in each of which inputs are held.

    lengths (K,): steps of the pieces; speed: the largest [m/s]; slowest: the least, as a share of it; heading [rad]: of the start, None
    where it does not say which way the vehicle goes; largest_turn [rad/s]; ends: of which all must hold.
    """

    step: float
    lengths: tuple[int, ...]
    speed: float
    slowest: float
    heading: float | None
    largest_turn: float
    ends: tuple[End, ...]
    in_words: str
    left_out: tuple[str, ...]

    @property
    def steps(self) -> int:
        """N."""
        return sum(self.lengths)

    def arcs(self, steps: int) -> Arcs:
        """Return the bounds of pieces of so many steps."""
        return arcs_of(self.largest_turn * steps * self.step / 2, steps)


def motion_of(problem: DesignProblem, lengths: tuple[int, ...] | None = None) -> AllowedMotion:
    """Return the motions of a problem; lengths: other pieces, as long as or parts of those in which inputs are held.

    Raises InputError with the reason where there is no such description.
    """
    system = problem.system
    if not isinstance(system, System):
        raise InputError("the system is none of the ready-made ones")
    if problem.shortest != problem.longest:
        raise InputError(f"the duration is free, {problem.shortest:g} to {problem.longest:g} s: a bound is one for one duration")
    held = held_lengths(problem)
    used = _divide(problem, held) if lengths is None else lengths
    if not _divides(used, held):
        raise InputError(f"pieces of {used} steps: must divide those of {held} steps in which inputs are held")
    slow, fast, is_along = _speeds(problem)
    turn = max(abs(value) for value in problem.bounds["turn_rate"])
    if turn * max(used) * problem.step / 2 > LARGEST_HALF_TURN:
        raise InputError("a step may turn by more than half a circle")
    ends, left_out = _limits(problem)
    family = "that hold their inputs over the problem's pieces" if max(held) > 1 else "that hold their inputs over each step"
    speeds = f"at {fast:g} m/s" if slow == 1 else f"at {slow * fast:g} to {fast:g} m/s"
    wind = " in the wind of the start" if len(problem.x0) > 3 else ""
    words = f"paths of {problem.duration:g} s from the start, {speeds}{wind}, turning by at most {turn:g} rad/s, {family}"
    words += ", that reach the goal" if ends else ""
    heading = float(problem.x0[2]) if is_along else None
    return AllowedMotion(problem.step, used, fast, slow, heading, turn, ends, words, left_out)


def held_lengths(problem: DesignProblem) -> tuple[int, ...]:
    """Steps of the pieces over which every path of the family holds its inputs."""
    path, steps = problem.path, problem.steps
    if isinstance(path, PiecewiseConstant):
        return tuple(piece_lengths(path.pieces, steps).tolist())
    if isinstance(path, BSpline | DubinsPath):
        return (1,) * steps
    raise InputError("the family of paths is none of the ready-made ones")


def _divide(problem: DesignProblem, held: tuple[int, ...]) -> tuple[int, ...]:
    """Pieces, taken apart where one might turn by more than half a circle, or where the bound gains and few pieces remain few."""
    half_turns = [max(map(abs, problem.bounds.get("turn_rate", (0.0, 0.0)))) * steps * problem.step / 2 for steps in held]
    for largest in (_FINE_HALF_TURN, LARGEST_HALF_TURN):
        parts = [split(steps, int(np.ceil(half_turn / largest))) for steps, half_turn in zip(held, half_turns, strict=True)]
        if sum(map(len, parts)) <= _FEW_PIECES:
            break
    return tuple(length for part in parts for length in part)


def split(steps: int, parts: int) -> tuple[int, ...]:
    """Return so many nearly equal parts, fewer where there are fewer steps."""
    parts = max(1, min(parts, steps))
    return tuple((steps * (i + 1)) // parts - (steps * i) // parts for i in range(parts))


def _divides(parts: tuple[int, ...], held: tuple[int, ...]) -> bool:
    return min(parts) > 0 and sum(parts) == sum(held) and set(np.cumsum(held).tolist()) <= set(np.cumsum(parts).tolist())


def _speeds(problem: DesignProblem) -> tuple[float, float, bool]:
    """The least speed as a share of the largest, the largest [m/s], and whether the vehicle goes where its heading points."""
    vehicle = problem.system.vehicle if isinstance(problem.system, System) else None
    names = problem.system.model.input_names
    if "turn_rate" not in names:
        raise InputError("the turn rate is no known input")
    if isinstance(vehicle, Dubins):
        return 1.0, vehicle.speed, True
    if isinstance(vehicle, Unicycle) and "speed" in names:
        low, high = problem.bounds["speed"]
        fast = max(abs(low), abs(high))
        return (max(low, 0.0) / fast if fast else 1.0), fast, low > 0
    if isinstance(vehicle, Omnidirectional) and vehicle.disturbance != "constant" and {"forward", "sideways"} <= set(names):
        forward, sideways = (max(map(abs, problem.bounds[name])) for name in ("forward", "sideways"))
        return 0.0, float(np.hypot(forward, sideways)), False
    raise InputError("its velocity through air or water does not turn with the heading, or is not known")


def _limits(problem: DesignProblem) -> tuple[tuple[End, ...], tuple[str, ...]]:
    """What of the limits is used, and which are left out."""
    ends, left_out = [], []
    wind = problem.x0[3:5] if len(problem.x0) > 3 else np.zeros(2)
    for limit in problem.constraints:
        if isinstance(limit, Goal | GoalPose):
            point = np.array(limit.point) - problem.x0[:2] - wind * problem.longest
            rounding = 1e-12 * (np.abs(limit.point).max() + np.abs(problem.x0[:2]).max() + np.abs(wind).max() * problem.longest)
            ends.append(End(point, limit.tolerance * (1 + _SLACK) + float(rounding)))
        if not isinstance(limit, Goal):
            left_out.append(type(limit).__name__ + (": its heading" if isinstance(limit, GoalPose) else ""))
    left_out += [f"the rate of {name}" for name in problem.rates]
    left_out += [type(budget.cost).__name__ for budget in problem.budgets] + (["the floor"] if problem.floor is not None else [])
    return tuple(ends), tuple(dict.fromkeys(left_out))
