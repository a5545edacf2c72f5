"""Where the solver begins: named input histories, the same for the same seed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count

import numpy as np

from obsdesign.design.problem import DesignProblem

_TURN = "turn_rate"


def start_inputs(problem: DesignProblem, seed: int) -> Iterator[tuple[str, np.ndarray]]:
    """Yield pairs (name, u (N, m)) without end: weaves and orbits to both sides where there is a turn rate, then smooth random ones."""
    t = (np.arange(problem.steps) + 0.5) / problem.steps  # share of the duration
    if _TURN in problem.system.model.input_names:
        yield from ((name, _shaped(problem, shape(t))) for name, shape in _SHAPES.items())
    yield from ((f"random {i}", _random(problem, t, np.random.default_rng([seed, i]))) for i in count(1))


def _weave(periods: float, side: int) -> Callable[[np.ndarray], np.ndarray]:
    """Heading swings by about 63 degrees to both sides."""
    return lambda t: side * 1.1 * 2 * np.pi * periods * np.cos(2 * np.pi * periods * t)


def _orbit(side: int) -> Callable[[np.ndarray], np.ndarray]:
    """One full turn in the first third, then straight."""
    return lambda t: side * 6 * np.pi * (t < 1 / 3)


# the heading's rate in radians per duration
_SHAPES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "weave of 2 periods, left first": _weave(2, 1),
    "weave of 2 periods, right first": _weave(2, -1),
    "weave of 1 period, left first": _weave(1, 1),
    "weave of 1 period, right first": _weave(1, -1),
    "orbit to the left": _orbit(1),
    "orbit to the right": _orbit(-1),
}


def _shaped(problem: DesignProblem, rate: np.ndarray) -> np.ndarray:
    """The turn rate follows the shape, every other input stays in the middle of its range."""
    u = np.tile((problem.lower + problem.upper) / 2, (problem.steps, 1))
    column = problem.system.model.input_names.index(_TURN)
    u[:, column] = np.clip(rate / problem.duration, problem.lower[column], problem.upper[column])
    return u


def _random(problem: DesignProblem, t: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A sum of five sines per input with random weights and phases, within 60 % of the input's range."""
    centre, half = (problem.lower + problem.upper) / 2, (problem.upper - problem.lower) / 2
    weights, phases = random.standard_normal((5, len(half))), random.uniform(0, 2 * np.pi, (5, len(half)))
    waves = sum(weights[k] * np.sin(np.pi * (k + 1) * t[:, None] + phases[k]) / (k + 1) for k in range(5))
    return centre + 0.6 * half * np.tanh(waves)
