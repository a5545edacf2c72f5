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
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.design.feasibility import is_feasible, violations
from obsdesign.design.feasible_search import FeasibilitySearch, search_feasible_path
from obsdesign.design.initial_guesses import shortest_inputs, shortest_time
from obsdesign.design.problem import DesignProblem
from obsdesign.design.upper_bound import cap_of
from obsdesign.design.violation import Violation
from obsdesign.paths.piecewise_constant import PiecewiseConstant

# durations and bounds so many times what is asked are tried as a relaxation, from so many starts each
_DURATION_FACTORS, _BOUND_FACTORS = (1.05, 1.1, 1.2, 1.3, 1.45, 1.6, 1.8, 2.0, 2.3, 2.6, 3.0, 3.5, 4.0), (1.2, 1.5, 2.0, 3.0, 4.0)
_STARTS, _HALVINGS = 4, 8
_TRIED_ON_FLOORS = 2  # where a start takes ten times as long
_ROUNDING = 1e-6  # share of a budget by which a way must be longer to be called too long


@dataclass(frozen=True)
class Explanation:
    """What stood in the way of the path that came nearest, and the smallest relaxations that were found; answer: none did."""

    violations: tuple[Violation, ...]
    in_words: str
    answer: FeasibilitySearch | None = None


# ---------------------------------------------------------------- before


def why_unreachable(problem: DesignProblem) -> str:
    """Say which goal or via point cannot be reached in time however one turns, or which budget is too small; "" if none."""
    fastest = fastest_ground_speed(problem)
    if fastest is None:
        return ""
    east, north = (float(problem.x0[i]) for i in problem.position)
    for constraint in problem.constraints:
        goal = _goal_position(constraint)
        if goal is None:
            continue
        (x, y), tolerance = goal
        way = float(np.hypot(x - east, y - north)) - tolerance
        last = constraint.span.last
        time = problem.longest if last is None else min(last, problem.longest)
        if way > fastest * time * (1 + 1e-9):
            first = np.ceil(way / fastest / problem.step - 1e-9) * problem.step
            return (
                f"{constraint}: {way:.4g} m away; at {fastest:.4g} m/s at most it cannot be reached in {time:g} s, not before {first:.4g} s"
            )
        for budget in problem.budgets:
            if isinstance(budget.cost, PathLength) and way > budget.at_most * (1 + _ROUNDING):
                return f"{constraint}: {way:.4g} m away, more than the budget of {budget.at_most:g} m of path length"
    return ""


def _goal_position(constraint: AbstractConstraint) -> tuple[tuple[float, float], float] | None:
    return (constraint.point, constraint.tolerance) if isinstance(constraint, (Goal, GoalPose, Via)) else None


def fastest_ground_speed(problem: DesignProblem) -> float | None:
    """Return a bound on |d(x, y)/dt| that holds on every path [m/s], or None where none is known.

    Known where the rate depends on the heading and on states that stay as they are: the largest over headings and the corners of
    the inputs' box, with the start's values of those states.
    """
    import casadi as ca

    model, names = problem.system.model, problem.system.model.state_names
    if not {"x", "y"} <= set(names) or model.unknown_inputs or model.period is not None:
        return None
    rate = model.undisturbed_rate
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
    velocities = [velocity(states.T, np.tile(corner[:, None], len(headings))).full() for corner in corners]
    if not all(_is_first_harmonic(headings, ground_velocity) for ground_velocity in velocities):
        return None
    largest = max(float(np.hypot(*ground_velocity).max()) for ground_velocity in velocities)
    return largest * (1 + 1e-5)  # between two headings of the grid it may be larger by (half a degree)^2 / 2


def _is_first_harmonic(headings: np.ndarray, velocity: np.ndarray) -> bool:
    """Whether a velocity (2, K) is a + b cos(heading) + c sin(heading): then nothing hides between the headings looked at."""
    waves = np.column_stack([np.ones_like(headings), np.cos(headings), np.sin(headings)])
    residual = velocity.T - waves @ np.linalg.lstsq(waves, velocity.T)[0]
    return bool(np.abs(residual).max() <= 1e-9 * max(float(np.abs(velocity).max()), np.finfo(float).tiny))


def why_hidden(problem: DesignProblem) -> str:
    """Say that the first stretch of no path reaches the floor; "" if nothing is known.

    lambda_min of its S W S is at most that of the block of it that no path changes (`cap_of`), the stretch being a path of its own.
    """
    floor = problem.floor
    if floor is None:
        return ""
    stretch = replace(
        problem, duration=floor.seconds, path=PiecewiseConstant(1), floor=None, constraints=(), rates={}, budgets=(), prices=(), about=(),
        weights=None, known=None, robust=None, criterion=MinEigenvalue(),
    )  # fmt: skip
    cap = cap_of(stretch)
    if cap is None or cap.value >= floor.value * (1 - _ROUNDING):
        return ""
    names = ", ".join(cap.states)
    return f"{floor}: no path gets beyond {cap.value:.4g}, which is known of {names} on all of them"


# ---------------------------------------------------------------- after


def explain(problem: DesignProblem, nearest: FeasibilitySearch, seed: int) -> Explanation:
    """Return what the nearest path falls short of, and what would have to give: more time, or wider bounds.

    A path that a relaxation leads to and that keeps all limits as they are is an answer: then there is nothing to explain.
    """
    broken = violations(problem, nearest.path)
    relaxations = [_wider_bounds(problem, nearest.path.u, seed), _longer_duration(problem, nearest.path.u, seed)]
    answer = next((relaxation.search for relaxation in relaxations if relaxation.is_feasible), None)
    if answer is not None:
        return Explanation((), "", answer)
    words = [
        f"none found in {nearest.starts} starts",
        *map(str, broken[:3]),
        *(relaxation.in_words for relaxation in relaxations if relaxation.in_words),
    ]
    return Explanation(broken, "; ".join(words))


@dataclass(frozen=True, eq=False)
class _ConstraintRelaxation:
    """What a relaxation led to: in words, "" if nowhere; is_feasible: to a path that needs no relaxation."""

    in_words: str = ""
    search: FeasibilitySearch | None = None
    is_feasible: bool = False


def _wider_bounds(problem: DesignProblem, u: np.ndarray, seed: int) -> _ConstraintRelaxation:
    """Say by how much which input would have to exceed its bounds, and when; "" if that does not help."""

    def with_bounds(factor: float) -> DesignProblem:
        """Return the problem with the bounds widened by a factor."""
        centre, half = (problem.lower + problem.upper) / 2, factor * (problem.upper - problem.lower) / 2
        names = problem.system.model.input_names
        wider = {name: (float(c - h), float(c + h)) for name, c, h in zip(names, centre, half, strict=True)}
        return replace(problem, bounds=wider)

    relaxation = _smallest_factor(with_bounds, _BOUND_FACTORS, u, seed, 1e-2)
    if relaxation is None:
        return _ConstraintRelaxation()
    path = relaxation.search.path
    if is_feasible(problem, path):
        return _ConstraintRelaxation("", relaxation.search, is_feasible=True)
    excess = np.maximum(path.u - problem.upper, problem.lower - path.u)
    k, j = np.unravel_index(int(excess.argmax()), excess.shape)
    if not excess[k, j] > 0:
        return _ConstraintRelaxation()
    signal = problem.system.model.inputs[int(j)]
    what = signal.name.replace("_", " ")
    return _ConstraintRelaxation(
        f"feasible with {what} at {path.t[k]:.4g} s exceeded by {excess[k, j]:.2g} {signal.unit}".rstrip(), relaxation.search
    )


def _longer_duration(problem: DesignProblem, u: np.ndarray, seed: int) -> _ConstraintRelaxation:
    """Say from which duration on a path was found; "" if none was."""
    if all(constraint.span.last is not None for constraint in problem.constraints):
        return _ConstraintRelaxation()
    unit = problem.step * (1 if problem.weights is None else len(np.asarray(problem.weights)))  # a schedule has as many segments then

    def with_duration(factor: float) -> DesignProblem:
        """Return the problem with the duration longer by a factor."""
        return problem.with_duration(max(1, round(factor * problem.longest / unit)) * unit)

    soonest = shortest_time(problem)
    first = () if soonest is None or soonest <= problem.longest else ((soonest + problem.step) / problem.longest,)
    relaxation = _smallest_factor(with_duration, tuple(sorted({*first, *_DURATION_FACTORS})), u, seed, unit / problem.longest)
    return (
        _ConstraintRelaxation()
        if relaxation is None
        else _ConstraintRelaxation(f"feasible from {with_duration(relaxation.factor).longest:.4g} s", relaxation.search)
    )


@dataclass(frozen=True, eq=False)
class _RelaxationFactor:
    """The least factor at which a path was found, and that path."""

    factor: float
    search: FeasibilitySearch


def _smallest_factor(
    make: Callable[[float], DesignProblem], factors: Sequence[float], u: np.ndarray, seed: int, width: float
) -> _RelaxationFactor | None:
    """Try growing factors until a path is found, then halve between the last that failed and the first that did not."""
    low = 1.0
    for factor in factors:
        search = _search_from(make(factor), u, seed)
        if search.is_feasible:
            return _bisect(make, low, _RelaxationFactor(factor, search), seed, width)
        low = factor
    return None


def _bisect(make: Callable[[float], DesignProblem], low: float, smallest: _RelaxationFactor, seed: int, width: float) -> _RelaxationFactor:
    for _ in range(_HALVINGS):
        if smallest.factor - low <= width * (1 + 1e-9):
            break
        middle = (low + smallest.factor) / 2
        search = _search_from(make(middle), smallest.search.path.u, seed)
        low, smallest = (low, _RelaxationFactor(middle, search)) if search.is_feasible else (middle, smallest)
    return smallest


def _search_from(problem: DesignProblem, u: np.ndarray, seed: int) -> FeasibilitySearch:
    """Look for a path that keeps all limits, from inputs u stretched, the shortest way, and a few others."""
    shortest = shortest_inputs(problem)
    stretched = u[np.minimum(np.arange(problem.steps) * len(u) // problem.steps, len(u) - 1)]
    return search_feasible_path(
        problem, seed, (stretched, *([] if shortest is None else [shortest])), _STARTS if problem.floor is None else _TRIED_ON_FLOORS
    )
