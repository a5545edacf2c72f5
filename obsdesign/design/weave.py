"""The baseline a pilot would fly: turn to a course, then weave about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.design.limits import node_margins
from obsdesign.design.problem import DesignProblem
from obsdesign.errors import InputError
from obsdesign.information.totals import batch_information
from obsdesign.simulation import simulate, states_from
from obsdesign.trajectory import Trajectory

_LEAD = 5.0  # seconds in which the course is turned to before weaving
_KEPT = 3  # points of a grid about which it is refined: the value has many local maxima
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
        return self.course * np.clip(t / _LEAD, 0, 1) + self.side * self.swing * np.sin(2 * np.pi * t / self.period)


_Rated = tuple[float, Weave, Trajectory]


def best_weave(problem: DesignProblem) -> tuple[Weave, Trajectory] | None:
    """Return the weave of highest value that meets the problem's bounds and constraints, or None where none does.

    A grid over course, swing, period and side; then finer grids about each of its three best points. Other inputs stay
    mid-range. Raises InputError for a system without a turn rate.
    """
    if _TURN not in problem.system.model.input_names:
        raise InputError("a weave needs a vehicle with a turn_rate")
    found = _best_of(problem, _grid(problem, _CENTRE, _WIDTH, 11, (1, -1)))
    for width in (_WIDTH / 6, _WIDTH / 15, _WIDTH / 40):
        near = [weave for _, weave, _ in found for weave in _grid(problem, _place(problem, weave), width, 5, (weave.side,))]
        found = sorted([*found, *_best_of(problem, near)], key=lambda candidate: -candidate[0])[:_KEPT]
    return found[0][1:] if found else None


def _place(problem: DesignProblem, weave: Weave) -> np.ndarray:
    return np.array([weave.course, weave.swing, weave.period / problem.longest])


def _grid(problem: DesignProblem, centre: np.ndarray, width: np.ndarray, points: int, sides: tuple[int, ...]) -> list[Weave]:
    courses, swings, periods = (np.linspace(c - w, c + w, points) for c, w in zip(centre, width, strict=True))
    allowed = periods[periods * problem.longest > 4 * problem.step]
    return [
        Weave(float(course), float(swing), float(period) * problem.longest, side)
        for course in courses
        for swing in swings[swings > 0]
        for period in allowed
        for side in sides
    ]


def _best_of(problem: DesignProblem, weaves: list[Weave]) -> list[_Rated]:
    """Return the best few of the weaves that meet bounds and constraints, best first."""
    if not weaves:
        return []
    inputs = np.stack([_inputs(problem, weave) for weave in weaves])
    inside = np.flatnonzero(np.all((inputs >= problem.lower) & (inputs <= problem.upper), axis=(1, 2)))
    states = _flown(problem, inputs[inside]) if inside.size else []
    kept = [i for i, x in zip(inside, states, strict=True) if node_margins(problem, x, inputs[i]).min(initial=0.0) >= 0]
    if not kept:
        return []
    values = _values(problem, inputs[kept])
    best = np.argsort(-values, kind="stable")[:_KEPT]
    return [(float(values[i]), weaves[kept[i]], simulate(problem.system, problem.x0, inputs[kept[i]], problem.step)) for i in best]


def _values(problem: DesignProblem, inputs: np.ndarray) -> np.ndarray:
    """Values (R,) of the paths of R input histories (R, N, m)."""
    if problem.criterion.knowledge is not None:
        return np.array([problem.value(simulate(problem.system, problem.x0, u, problem.step)) for u in inputs])
    every = batch_information(problem.system, np.tile(problem.x0, (len(inputs), 1)), inputs, problem.step).sum(axis=1)
    return np.array([problem.criterion.value(W) for W in problem.scaled(every)])


def _inputs(problem: DesignProblem, weave: Weave) -> np.ndarray:
    u = np.tile((problem.lower + problem.upper) / 2, (problem.steps, 1))
    t = np.arange(problem.steps) * problem.step
    u[:, problem.system.model.input_names.index(_TURN)] = weave.turn_rates(t, problem.step)
    return u


def _flown(problem: DesignProblem, inputs: np.ndarray) -> np.ndarray:
    """States (R, N+1, n) of the paths of R input histories (R, N, m)."""
    return states_from(problem.system, np.tile(problem.x0, (len(inputs), 1)), inputs, problem.step)
