"""Many paths to look at before any of them is worked on: held inputs, shortest ways stretched to the duration, random ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice, product

import numpy as np

from obsdesign.constraints.goal import Goal
from obsdesign.constraints.goal_pose import GoalPose
from obsdesign.constraints.goal_region import GoalRegion
from obsdesign.constraints.loiter import Loiter
from obsdesign.curves import Curve, curves
from obsdesign.design.initial_guesses import TURN_RATE, start_inputs
from obsdesign.design.problem import DesignProblem
from obsdesign.errors import InputError
from obsdesign.paths.dubins_path import DubinsPath
from obsdesign.vehicles.dubins import Dubins

_INITIAL_GUESSES = 10  # starts of the climbs that are candidates too
_MAX_COMBINATIONS = 27  # combinations of held inputs
_RADII = np.geomspace(1.0, 20.0, 16)  # of stretched curves, in least radii
_HALVINGS = 12  # of a bracket of radii: to 1 / 4096 of it, as what is found is where a local solve begins


def heuristic_inputs(problem: DesignProblem, seed: int) -> Iterator[np.ndarray]:
    """Yield inputs (N, m): extreme, middle and zero ones held, ways to the goal of the whole duration, the shapes of climbs."""
    yield from _constant_inputs(problem)
    yield from _goal_inputs(problem)
    if not isinstance(problem.path, DubinsPath):  # whose fit takes longer than all else
        yield from (u for _, u in islice(start_inputs(problem, seed), _INITIAL_GUESSES))


def parameters_of(problem: DesignProblem, inputs: Iterator[np.ndarray]) -> np.ndarray:
    """Return parameters (R, q) of the problem's path family near input histories (N, m)."""
    lower, upper = problem.path.box(problem.grid)
    parameters = [np.clip(problem.path.fit(u, problem.grid), lower, upper) for u in inputs]
    return np.array(parameters).reshape(-1, len(lower))


def random_parameters(problem: DesignProblem, count: int, random: np.random.Generator) -> np.ndarray:
    """Return parameters (count, q) in the box: levels held over runs of them, waves, and each on its own, in turn."""
    lower, upper = problem.path.box(problem.grid)
    q, m = len(lower), len(problem.grid.names)
    share = np.empty((count, q))
    for i in range(count):
        share[i] = (_levels, _waves, _independent)[i % 3](q, m, random)
    return lower + share * (upper - lower)


def _levels(q: int, m: int, random: np.random.Generator) -> np.ndarray:
    """A few runs, each at the lowest, the middle or the highest value, or anywhere."""
    length = max(1, q // m)
    runs = int(random.integers(1, min(length, 6) + 1))
    edges = np.sort(random.integers(0, length, (m, runs)), axis=1)
    levels = np.where(random.random((m, runs + 1)) < 0.5, random.integers(0, 3, (m, runs + 1)) / 2, random.random((m, runs + 1)))
    index = (np.arange(length) >= edges[:, :, None]).sum(axis=1)
    return np.resize(np.take_along_axis(levels, index, axis=1), q)


def _waves(q: int, m: int, random: np.random.Generator) -> np.ndarray:
    length = max(1, q // m)
    t = np.linspace(0, 1, length)
    waves = [
        np.sin(2 * np.pi * (random.uniform(0, 2) * t + random.random())) * random.random() + random.uniform(-0.5, 0.5) for _ in range(m)
    ]
    return np.resize(np.clip(0.5 + 0.5 * np.concatenate(waves), 0, 1), q)


def _independent(q: int, m: int, random: np.random.Generator) -> np.ndarray:
    return random.random(q)


def _constant_inputs(problem: DesignProblem) -> Iterator[np.ndarray]:
    """Every combination of the lowest, the highest and the middle value of each input, and 0 where it is allowed."""
    few = len(problem.lower) == 1
    sides = []
    for low, high in zip(problem.lower.tolist(), problem.upper.tolist(), strict=True):
        rest = 0.0 if low < 0 < high else (low + high) / 2
        sides.append(dict.fromkeys((rest, low, high, (rest + low) / 2, (rest + high) / 2) if few else (rest, low, high)))
    for held in islice(product(*sides), _MAX_COMBINATIONS):
        yield np.tile(np.clip(held, problem.lower, problem.upper), (problem.steps, 1))


# ---------------------------------------------------------------- ways of the whole duration


def _goal_inputs(problem: DesignProblem) -> Iterator[np.ndarray]:
    """Curves to the goal that take the whole duration, for what turns: loiter circles before or after, or wider arcs.

    In air that moves with a constant wind the goal is where it will have been blown to by then: exact for constant airspeed.
    """
    model = problem.system.model
    names, speeds = model.input_names, _airspeeds(problem)
    if TURN_RATE not in names or not {"x", "y", "heading"} <= set(model.state_names):
        return
    column, seconds = names.index(TURN_RATE), problem.steps * problem.step
    largest_rate = min(-problem.lower[column], problem.upper[column])
    if largest_rate <= 0:
        return
    pose_indices = [model.state_names.index(name) for name in ("x", "y", "heading")]
    wind = np.array([problem.x0[model.state_names.index(name)] if name in model.state_names else 0.0 for name in ("wind_x", "wind_y")])
    for speed, goal in product(speeds, _goal_targets(problem)):
        target = np.array(goal)
        target[:2] -= wind * seconds
        for curve in _curves_of_length(problem.x0[pose_indices], target, speed * seconds, speed / largest_rate):
            u = np.tile((problem.lower + problem.upper) / 2, (problem.steps, 1))
            if "speed" in names:
                u[:, names.index("speed")] = speed
            rates = curve.turn_rates(speed, np.arange(problem.steps + 1) * problem.step)
            u[:, column] = np.clip(rates, problem.lower[column], problem.upper[column])
            yield u


def _airspeeds(problem: DesignProblem) -> tuple[float, ...]:
    vehicle, names = getattr(problem.system, "vehicle", None), problem.system.model.input_names
    if isinstance(vehicle, Dubins):
        return (vehicle.speed,)
    if "speed" in names:
        low, high = problem.bounds["speed"]
        return tuple(speed for speed in (high, (low + high) / 2, low) if speed > 0)
    return ()


def _goal_targets(problem: DesignProblem) -> list[tuple[float, ...]]:
    targets: list[tuple[float, ...]] = []
    for constraint in problem.constraints:
        if isinstance(constraint, GoalPose):
            targets.append((*constraint.point, constraint.heading))
        elif isinstance(constraint, Goal):
            targets.append(constraint.point)
        elif isinstance(constraint, GoalRegion):
            targets.append(tuple(np.mean(constraint.corners, axis=0).tolist()))
        elif isinstance(constraint, Loiter) and constraint.last is None:
            targets.append(constraint.centre)
    return targets[:2]


def _curves_of_length(start: np.ndarray, goal: np.ndarray, length: float, radius: float) -> Iterator[Curve]:
    """Curves from a pose to a goal that are so long [m]: whole circles before or after the shortest of each word, or larger radii."""
    circle = 2 * np.pi * radius
    try:
        candidates = curves(start, goal, radius)
    except InputError:
        return
    for curve in candidates:
        remaining = length - curve.length
        if remaining < -1e-9 * length:
            continue
        turns = int(remaining // circle)
        if turns:
            loiter_radius = remaining / (2 * np.pi * turns)  # circles of that radius take what is left
            yield from (_with_loiter(curve, side, turns, loiter_radius / radius) for side in "LR")
        else:
            yield curve
    yield from _wider_curves(start, goal, length, radius, [curve.word for curve in candidates if curve.length < length])


def _with_loiter(curve: Curve, side: str, turns: int, radius_ratio: float) -> Curve:
    """A curve after circles of `radius_ratio` times its radius: as arcs of its own radius, turned as far, with straights between them."""
    letters, lengths = "", []
    for _ in range(8 * turns):  # an octagon with round corners is as long as the circle that it stands for
        letters += side + "S"
        lengths += [2 * np.pi * curve.radius / 8, 2 * np.pi * curve.radius * (radius_ratio - 1) / 8]
    return Curve(letters + curve.word, (*lengths, *curve.lengths), curve.radius)


def _wider_curves(start: np.ndarray, goal: np.ndarray, length: float, radius: float, words: Sequence[str]) -> Iterator[Curve]:
    """For each word a curve of larger radius that is so long: the first in a row of radii that is longer, then by bisection."""
    curves_by_radius = {
        float(trial_radius): {curve.word: curve for curve in curves(start, goal, float(trial_radius))} for trial_radius in radius * _RADII
    }
    for word in dict.fromkeys(words):
        lengths = {trial_radius: by_word[word].length for trial_radius, by_word in curves_by_radius.items() if word in by_word}
        high = next((trial_radius for trial_radius, long in lengths.items() if long >= length), None)
        if high is None:
            continue
        low = max((trial_radius for trial_radius in curves_by_radius if trial_radius < high), default=radius)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            middle_length = {curve.word: curve.length for curve in curves(start, goal, middle)}.get(word, 0.0)
            low, high = (low, middle) if middle_length >= length else (middle, high)
        yield from (curve for curve in curves(start, goal, high) if curve.word == word)
