"""The baseline a pilot would fly: turn to a course, then weave about it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from obsdesign.design.feasibility import is_feasible
from obsdesign.design.nlp.constraint_rows import node_margins_of_paths
from obsdesign.design.problem import DesignProblem
from obsdesign.dynamics.simulation import states_from
from obsdesign.errors import InputError
from obsdesign.trajectory import Trajectory

_LEAD_SECONDS = 5.0  # seconds in which the course is turned to before weaving
_RATED_BY_DRAWS = 64  # weaves of highest value that are judged by the prior's draws too, where the problem is robust
_BEST_COUNT = 3  # points of a grid about which it is refined: the value has many local maxima
# course [rad], swing [rad], period [durations]: middle and half width of the grid
_CENTRE, _WIDTH = np.array([0.0, 0.9, 0.5]), np.array([0.6, 0.9, 0.45])
_TURN = "turn_rate"


@dataclass(frozen=True)
class Weave:
    """Heading = start + course + side * swing * sin(2 pi t / period), reached by turn rates held over each step.

    course [rad]: turned in the first 5 s; swing [rad]; period [s]; side +1: left first.
    """

    course: float
    swing: float
    period: float
    side: int

    def turn_rates(self, t: np.ndarray, step: float) -> np.ndarray:
        """Return the turn rate [rad/s] of each step that begins at t (N,)."""
        heading = self._heading(np.append(t, t[-1] + step))
        return np.diff(heading) / step

    def _heading(self, t: np.ndarray) -> np.ndarray:
        return self.course * np.clip(t / _LEAD_SECONDS, 0, 1) + self.side * self.swing * np.sin(2 * np.pi * t / self.period)


_RatedWeave = tuple[float, Weave, Trajectory]


def best_weave(problem: DesignProblem) -> tuple[Weave, Trajectory] | None:
    """Return the weave of highest objective that meets all limits of the problem, or None where none does.

    Objective: as of a design, value(path) minus prices, or that of the prior's draws where the problem is robust: among the 64
    weaves of highest value. A grid over course, swing, period and side; then finer grids about each of its three best points.
    Other inputs stay mid-range. Raises InputError for a system without a turn rate.
    """
    if _TURN not in problem.system.model.input_names:
        raise InputError("a weave needs a vehicle with a turn_rate")
    best = _best_of(problem, _grid(problem, _CENTRE, _WIDTH, 11, (1, -1)))
    for width in (_WIDTH / 6, _WIDTH / 15, _WIDTH / 40):
        neighbours = [weave for _, weave, _ in best for weave in _grid(problem, _grid_point(problem, weave), width, 5, (weave.side,))]
        best = sorted([*best, *_best_of(problem, neighbours)], key=lambda candidate: -candidate[0])[:_BEST_COUNT]
    return best[0][1:] if best else None


def _grid_point(problem: DesignProblem, weave: Weave) -> np.ndarray:
    return np.array([weave.course, weave.swing, weave.period / problem.longest])


def _grid(problem: DesignProblem, centre: np.ndarray, width: np.ndarray, points: int, sides: tuple[int, ...]) -> list[Weave]:
    courses, swings, periods = (np.linspace(c - w, c + w, points) for c, w in zip(centre, width, strict=True))
    long_enough = periods[periods * problem.longest > 4 * problem.step]
    return [
        Weave(float(course), float(swing), float(period) * problem.longest, side)
        for course in courses
        for swing in swings[swings > 0]
        for period in long_enough
        for side in sides
    ]


def _best_of(problem: DesignProblem, weaves: list[Weave]) -> list[_RatedWeave]:
    """Return the best few of the weaves that meet all limits, best first."""
    if not weaves:
        return []
    inputs = np.stack([_inputs(problem, weave) for weave in weaves])
    within_bounds = np.flatnonzero(
        np.all((inputs >= problem.lower) & (inputs <= problem.upper), axis=(1, 2)) & _keeps_rates(problem, inputs)
    )
    if not within_bounds.size:
        return []
    margins = node_margins_of_paths(problem, _simulate_states(problem, inputs[within_bounds]), inputs[within_bounds])
    within_limits = [i for i, values in zip(within_bounds, margins, strict=True) if values.min(initial=0.0) >= 0]
    feasible = _feasible_weaves(problem, [weaves[i] for i in within_limits], inputs[within_limits]) if within_limits else iter(())
    return list(islice(feasible, _BEST_COUNT))


def _feasible_weaves(problem: DesignProblem, weaves: list[Weave], inputs: np.ndarray) -> Iterator[_RatedWeave]:
    """Yield those of the weaves with inputs (R, N, m) that break no limit between nodes either, best first."""
    values = _objectives(problem, inputs)
    for i in np.argsort(-values, kind="stable"):
        path = problem.path_along(inputs[i])
        if is_feasible(problem, path):
            yield float(values[i]), weaves[i], path


def _objectives(problem: DesignProblem, inputs: np.ndarray) -> np.ndarray:
    """What is maximised (R,) of the paths of R input histories (R, N, m)."""
    values = problem.values(np.tile(problem.x0, (len(inputs), 1)), inputs)
    if not problem.prices and problem.robust is None:
        return values
    selected = np.arange(len(inputs)) if problem.robust is None else np.argsort(-values, kind="stable")[:_RATED_BY_DRAWS]
    paths = [problem.path_along(inputs[i]) for i in selected]
    objectives = np.full(len(inputs), -np.inf)
    if problem.robust is None:
        objectives[selected] = values - [problem.price(path) for path in paths]
    else:
        objectives[selected] = [problem.objective(path) for path in paths]
    return objectives


def _keeps_rates(problem: DesignProblem, inputs: np.ndarray) -> np.ndarray:
    """Whether (R,) inputs (R, N, m) change no faster than their rates."""
    names = problem.system.model.input_names
    rate_limits = np.array([problem.rates.get(name, np.inf) for name in names])
    return np.all(np.abs(np.diff(inputs, axis=1)) <= rate_limits * problem.step, axis=(1, 2))


def _inputs(problem: DesignProblem, weave: Weave) -> np.ndarray:
    u = np.tile((problem.lower + problem.upper) / 2, (problem.steps, 1))
    t = np.arange(problem.steps) * problem.step
    u[:, problem.system.model.input_names.index(_TURN)] = weave.turn_rates(t, problem.step)
    return u


def _simulate_states(problem: DesignProblem, inputs: np.ndarray) -> np.ndarray:
    """States (R, N+1, n) of the paths of R input histories (R, N, m)."""
    return states_from(problem.system, np.tile(problem.x0, (len(inputs), 1)), inputs, problem.step, substeps=problem.substeps)
