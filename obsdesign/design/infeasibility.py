"""Why there is no path: by geometry before a solver starts, by what the solver could not satisfy afterwards."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.constraints.goal import Goal
from obsdesign.constraints.goal_pose import GoalPose
from obsdesign.constraints.via import Via
from obsdesign.costs.path_length import PathLength
from obsdesign.design.aim import nothing
from obsdesign.design.climbing import Climbed, Task, climbed
from obsdesign.design.limits import Shortfall, is_feasible, shortfalls
from obsdesign.design.problem import DesignProblem
from obsdesign.design.starts import shortest_inputs, shortest_time

_FACTORS = (1.2, 1.5, 2.0, 3.0, 4.0)  # durations and bounds so many times what is asked are tried as a relaxation
_HALVINGS = 6


@dataclass(frozen=True)
class Explanation:
    """What stood in the way of the path that came nearest, and the smallest relaxations that were found."""

    shortfalls: tuple[Shortfall, ...]
    in_words: str


# ---------------------------------------------------------------- before


def why_unreachable(problem: DesignProblem) -> str:
    """Say which goal or via point cannot be reached in time however one turns, or which budget is too small; "" if none."""
    fastest = fastest_ground_speed(problem)
    if fastest is None:
        return ""
    east, north = (float(problem.x0[i]) for i in problem.position)
    for constraint in problem.constraints:
        place = _place(constraint)
        if place is None:
            continue
        (x, y), tolerance = place
        way = float(np.hypot(x - east, y - north)) - tolerance
        last = constraint.span.last
        time = problem.longest if last is None else min(last, problem.longest)
        if way > fastest * time * (1 + 1e-9):
            first = np.ceil(way / fastest / problem.step - 1e-9) * problem.step
            return (
                f"{constraint}: {way:.4g} m away; at {fastest:.4g} m/s at most it cannot be reached in {time:g} s, not before {first:.4g} s"
            )
        for budget in problem.budgets:
            if isinstance(budget.cost, PathLength) and way > budget.at_most:
                return f"{constraint}: {way:.4g} m away, more than the budget of {budget.at_most:g} m of path length"
    return ""


def _place(constraint: AbstractConstraint) -> tuple[tuple[float, float], float] | None:
    return (constraint.point, constraint.tolerance) if isinstance(constraint, (Goal, GoalPose, Via)) else None


def fastest_ground_speed(problem: DesignProblem) -> float | None:
    """Return a bound on |d(x, y)/dt| that holds on every path [m/s], or None where none is known.

    Known where the rate depends on the heading and on states that stay as they are: the largest over headings and the corners of
    the inputs' box, with the start's values of those states.
    """
    import casadi as ca

    model, names = problem.system.model, problem.system.model.state_names
    if not {"x", "y"} <= set(names) or model.unknown_inputs:
        return None
    rate = model.drift + model.B @ model.u
    ground = ca.vertcat(rate[names.index("x")], rate[names.index("y")])
    moving = [i for i, name in enumerate(names) if not rate[i].is_zero() and name != "heading"]
    if any(ca.depends_on(ground, model.x[i]) for i in moving):
        return None
    velocity = ca.Function("ground", [model.x, model.u], [ground])
    corners = np.array(np.meshgrid(*zip(problem.lower, problem.upper, strict=True))).reshape(len(problem.lower), -1).T
    headings = np.linspace(-np.pi, np.pi, 721)
    states = np.tile(problem.x0, (len(headings), 1))
    if "heading" in names:
        states[:, names.index("heading")] = headings
    largest = max(float(np.hypot(*velocity(states.T, np.tile(corner[:, None], len(headings))).full()).max()) for corner in corners)
    return largest * (1 + 1e-5)  # between two headings of the grid it may be larger by (half a degree)^2 / 2


# ---------------------------------------------------------------- after


def nearest_to_limits(problem: DesignProblem, found: Sequence[Climbed]) -> Climbed | None:
    """Return the path of least shortfall: climbed to with limits alone, from where climbs ended and from the shortest way."""
    tasks = [each.u for each in found[:2]]
    shortest = shortest_inputs(problem)
    tasks += [] if shortest is None else [shortest]
    reached = [_to_limits(problem, u) for u in tasks]
    return min(reached, key=lambda each: -min((s.margin for s in shortfalls(problem, each.path)), default=0.0), default=None)


def rescued(problem: DesignProblem, nearest: Climbed | None) -> Climbed | None:
    """Return a climb from a path that meets all limits, where one was found though no start has an answer."""
    if nearest is None or not is_feasible(problem, nearest.path):
        return None
    return climbed(Task(problem, "from a path within the limits", nearest.u, (problem.path,), True))


def explained(problem: DesignProblem, nearest: Climbed | None) -> Explanation:
    """Return what the nearest path falls short of, and what would have to give: more time, or wider bounds."""
    short = () if nearest is None else shortfalls(problem, nearest.path)
    if nearest is None or not short:
        return Explanation((), "a path within the limits was found, but no climb from it or from the starts came to an end")
    words = [str(each) for each in short[:3]]
    words += [text for text in (_wider_bounds(problem, nearest), _longer(problem, nearest)) if text]
    return Explanation(short, "; ".join(words))


def _to_limits(problem: DesignProblem, u: np.ndarray) -> Climbed:
    bare = replace(problem, prices=(), robust=None)
    return climbed(Task(bare, "limits", u, (problem.path,), False, nothing(len(problem.x0))))


def _wider_bounds(problem: DesignProblem, nearest: Climbed) -> str:
    """Say by how much which input would have to exceed its bounds, and when; "" if that does not help."""

    def with_bounds(factor: float) -> DesignProblem:
        centre, half = (problem.lower + problem.upper) / 2, factor * (problem.upper - problem.lower) / 2
        names = problem.system.model.input_names
        wide = {name: (float(c - h), float(c + h)) for name, c, h in zip(names, centre, half, strict=True)}
        return replace(problem, bounds=wide)

    found = _least(with_bounds, _FACTORS, nearest.u, 1e-2)
    if found is None:
        return ""
    path = found.reached.path
    beyond = np.maximum(path.u - problem.upper, problem.lower - path.u)
    k, j = np.unravel_index(int(beyond.argmax()), beyond.shape)
    signal = problem.system.model.inputs[int(j)]
    return f"feasible with {signal.name.replace('_', ' ')} at {path.t[k]:.4g} s exceeded by {beyond[k, j]:.2g} {signal.unit}".rstrip()


def _longer(problem: DesignProblem, nearest: Climbed) -> str:
    """Say from which duration on a path was found; "" if none was."""
    if all(constraint.span.last is not None for constraint in problem.constraints):
        return ""

    def lasting(factor: float) -> DesignProblem:
        return problem.lasting(max(1, round(factor * problem.longest / problem.step)) * problem.step)

    soonest = shortest_time(problem)
    first = () if soonest is None or soonest <= problem.longest else ((soonest + problem.step) / problem.longest,)
    found = _least(lasting, tuple(sorted({*first, *_FACTORS})), nearest.u, problem.step / problem.longest)
    return "" if found is None else f"feasible from {lasting(found.factor).longest:.4g} s"


@dataclass(frozen=True, eq=False)
class _Relaxed:
    """The least factor at which a path was found, and that path."""

    factor: float
    reached: Climbed


def _least(make: Callable[[float], DesignProblem], factors: Sequence[float], u: np.ndarray, width: float) -> _Relaxed | None:
    """Try growing factors until a path is found, then bisect between the last that failed and the first that did not."""
    low = 1.0
    for factor in factors:
        reached = _tried(make(factor), u)
        if reached is not None:
            return _bisected(make, low, _Relaxed(factor, reached), width)
        low = factor
    return None


def _bisected(make: Callable[[float], DesignProblem], low: float, found: _Relaxed, width: float) -> _Relaxed:
    for _ in range(_HALVINGS):
        if found.factor - low <= width:
            break
        middle = (low + found.factor) / 2
        reached = _tried(make(middle), found.reached.u)
        low, found = (middle, found) if reached is None else (low, _Relaxed(middle, reached))
    return found


def _tried(problem: DesignProblem, u: np.ndarray) -> Climbed | None:
    """Return a path that meets all limits, from inputs u stretched, or from the shortest way; None where neither led to one."""
    shortest = shortest_inputs(problem)
    stretched = u[np.minimum(np.arange(problem.steps) * len(u) // problem.steps, len(u) - 1)]
    for each in [stretched, *([] if shortest is None else [shortest])]:
        reached = _to_limits(problem, each)
        if is_feasible(problem, reached.path):
            return reached
    return None
