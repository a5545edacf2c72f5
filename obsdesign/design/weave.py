"""The baseline a pilot would fly: turn to a course, then weave about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.compile import advance
from obsdesign.design.problem import DesignProblem
from obsdesign.errors import InputError
from obsdesign.information.gramian import variational_gramian
from obsdesign.simulation import simulate
from obsdesign.trajectory import Trajectory

_LEAD = 5.0  # seconds in which the course is turned to before weaving
_ROUNDS = 3  # the grid is refined about its best point this many times
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


def best_weave(problem: DesignProblem) -> tuple[Weave, Trajectory] | None:
    """Return the weave of highest value that meets the problem's bounds and constraints, or None where none does.

    A grid over course, swing, period and side, refined three times about its best point. Other inputs stay mid-range.
    Raises InputError for a system without a turn rate.
    """
    if _TURN not in problem.system.model.input_names:
        raise InputError("a weave needs a vehicle with a turn_rate")
    best: tuple[float, Weave, Trajectory] | None = None
    centre, width = np.array([0.0, 0.9, 0.5]), np.array([0.6, 0.9, 0.45])
    for _ in range(_ROUNDS):
        found = _best_of(problem, _grid(problem, centre, width, best))
        if found is None:
            break
        if best is None or found[0] > best[0]:
            best = found
        weave = best[1]
        centre, width = np.array([weave.course, weave.swing, weave.period / problem.duration]), width / 4
    return None if best is None else best[1:]


def _grid(problem: DesignProblem, centre: np.ndarray, width: np.ndarray, best: tuple[float, Weave, Trajectory] | None) -> list[Weave]:
    courses, swings, periods = (np.linspace(c - w, c + w, 13) for c, w in zip(centre, width, strict=True))
    sides = (1, -1) if best is None else (best[1].side,)
    allowed = periods[periods * problem.duration > 4 * problem.step]
    return [
        Weave(float(course), float(swing), float(period) * problem.duration, side)
        for course in courses
        for swing in swings[swings > 0]
        for period in allowed
        for side in sides
    ]


def _best_of(problem: DesignProblem, weaves: list[Weave]) -> tuple[float, Weave, Trajectory] | None:
    inputs = np.stack([_inputs(problem, weave) for weave in weaves])
    inside = np.all((inputs >= problem.lower) & (inputs <= problem.upper), axis=(1, 2))
    kept = np.flatnonzero(inside)
    states = _flown(problem, inputs[kept])
    kept = [i for i, x in zip(kept, states, strict=True) if problem.margins(x).min(initial=0.0) >= 0]
    paths = [(weaves[i], simulate(problem.system, problem.x0, inputs[i], problem.step)) for i in kept]
    rated = [(problem.value(variational_gramian(problem.system, path)), weave, path) for weave, path in paths]
    return max(rated, key=lambda candidate: candidate[0], default=None)


def _inputs(problem: DesignProblem, weave: Weave) -> np.ndarray:
    u = np.tile((problem.lower + problem.upper) / 2, (problem.steps, 1))
    t = np.arange(problem.steps) * problem.step
    u[:, problem.system.model.input_names.index(_TURN)] = weave.turn_rates(t, problem.step)
    return u


def _flown(problem: DesignProblem, inputs: np.ndarray) -> np.ndarray:
    """States (R, N+1, n) of the paths of R input histories (R, N, m), side by side."""
    count = len(inputs)
    fly = advance(problem.system, problem.step).map(count)
    idle = np.zeros((len(problem.system.model.unknown_inputs), count))
    states = [np.tile(problem.x0, (count, 1))]
    for k in range(problem.steps):
        states.append(fly(states[k].T, inputs[:, k].T, idle).full().T)
    return np.stack(states, axis=1)
