"""Where the solver begins: named input histories, the same for the same seed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count

import numpy as np

from obsdesign.constraints.goal import Goal
from obsdesign.constraints.goal_pose import GoalPose
from obsdesign.constraints.via import Via
from obsdesign.curves import Curve, intercept, shortest_through
from obsdesign.design.problem import DesignProblem
from obsdesign.errors import InputError
from obsdesign.vehicles.dubins import Dubins

TURN_RATE = "turn_rate"


def start_inputs(problem: DesignProblem, seed: int) -> Iterator[tuple[str, np.ndarray]]:
    """Yield pairs (name, u (N, m)) without end.

    Where there is a turn rate: the shortest way to the goal, for a Dubins vehicle; weaves, orbits and figures of eight to both
    sides. Then smooth random ones.
    """
    t = (np.arange(problem.steps) + 0.5) / problem.steps  # share of the duration
    if TURN_RATE in problem.system.model.input_names:
        shortest = shortest_inputs(problem)
        if shortest is not None:
            yield "shortest", shortest
        yield from ((name, _shape_inputs(problem, shape(t))) for name, shape in _SHAPES.items())
    yield from ((f"random {i}", _random(problem, t, np.random.default_rng([seed, i]))) for i in count(1))


def shortest_inputs(problem: DesignProblem) -> np.ndarray | None:
    """Return u (N, m) of the shortest way of a Dubins vehicle through the via points to the goal, straight on after it; None without.

    Constant wind is known from the start state; with via points and wind the way is the one in still air.
    """
    shortest = _shortest_path(problem)
    if shortest is None:
        return None
    curve, speed = shortest
    return np.clip(curve.turn_rates(speed, np.arange(problem.steps + 1) * problem.step), problem.lower[0], problem.upper[0])[:, None]


def shortest_time(problem: DesignProblem) -> float | None:
    """Return the time [s] of that way, or None without."""
    shortest = _shortest_path(problem)
    return None if shortest is None else shortest[0].length / shortest[1]


def _shortest_path(problem: DesignProblem) -> tuple[Curve, float] | None:
    """The curve and the airspeed."""
    vehicle, goal = getattr(problem.system, "vehicle", None), _goal_of(problem)
    largest_rate = min(-problem.lower[0], problem.upper[0])
    if not isinstance(vehicle, Dubins) or goal is None or largest_rate <= 0:
        return None
    radius, points = vehicle.speed / largest_rate, [constraint.point for constraint in problem.constraints if isinstance(constraint, Via)]
    start = problem.x0[:3]
    wind = (float(problem.x0[3]), float(problem.x0[4])) if vehicle.wind == "constant" else (0.0, 0.0)
    try:
        if points:
            parts = shortest_through(start, points, goal, radius=radius)
            return Curve(
                "".join(part.word for part in parts), tuple(length for part in parts for length in part.lengths), radius
            ), vehicle.speed
        return intercept(start, goal, wind, vehicle.speed, radius), vehicle.speed
    except InputError:
        return None  # blown away: the other starts will have to find a way


def _goal_of(problem: DesignProblem) -> tuple[float, ...] | None:
    for constraint in problem.constraints:
        if isinstance(constraint, GoalPose):
            return (*constraint.point, constraint.heading)
        if isinstance(constraint, Goal):
            return constraint.point
    return None


def _weave(periods: float, side: int) -> Callable[[np.ndarray], np.ndarray]:
    """Heading swings by about 63 degrees to both sides."""
    return lambda t: side * 1.1 * 2 * np.pi * periods * np.cos(2 * np.pi * periods * t)


def _orbit(side: int) -> Callable[[np.ndarray], np.ndarray]:
    """One full turn in the first third, then straight."""
    return lambda t: side * 6 * np.pi * (t < 1 / 3)


def _eight(side: int) -> Callable[[np.ndarray], np.ndarray]:
    """One full turn to each side in the first two thirds, then straight."""
    return lambda t: side * 6 * np.pi * ((t < 1 / 3).astype(float) - ((t >= 1 / 3) & (t < 2 / 3)))


# the heading's rate in radians per duration
_SHAPES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "weave of 2 periods, left first": _weave(2, 1),
    "weave of 2 periods, right first": _weave(2, -1),
    "weave of 1 period, left first": _weave(1, 1),
    "weave of 1 period, right first": _weave(1, -1),
    "orbit to the left": _orbit(1),
    "orbit to the right": _orbit(-1),
    "figure of eight, left first": _eight(1),
    "figure of eight, right first": _eight(-1),
}


def _shape_inputs(problem: DesignProblem, rate: np.ndarray) -> np.ndarray:
    """The turn rate follows the shape, every other input stays in the middle of its range."""
    u = np.tile((problem.lower + problem.upper) / 2, (problem.steps, 1))
    column = problem.system.model.input_names.index(TURN_RATE)
    u[:, column] = np.clip(rate / problem.grid.duration, problem.lower[column], problem.upper[column])
    return u


def _random(problem: DesignProblem, t: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A sum of five sines per input with random weights and phases, within 60 % of the input's range."""
    centre, half = (problem.lower + problem.upper) / 2, (problem.upper - problem.lower) / 2
    weights, phases = random.standard_normal((5, len(half))), random.uniform(0, 2 * np.pi, (5, len(half)))
    waves = sum(weights[k] * np.sin(np.pi * (k + 1) * t[:, None] + phases[k]) / (k + 1) for k in range(5))
    return centre + 0.6 * half * np.tanh(waves)
