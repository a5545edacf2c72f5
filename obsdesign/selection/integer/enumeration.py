"""Trying all that is left, where that is cheaper than bounding parts of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.selection.integer.branch_and_bound import Explored, bar, constants_of, schedules_of, within_limits
from obsdesign.selection.integer.reduced_problem import Layer, Walks, information_in, price_vector
from obsdesign.selection.problem import Instance
from obsdesign.selection.relaxation.dual import Dual

MOST = 1_000_000  # schedules that are tried
_WIDTH = 16_384  # at a time
_PRICES = 4  # duals that are asked first, each in a few additions, whether a schedule is worth a matrix


@dataclass(frozen=True, eq=False)
class _Part:
    """Partial schedules with the first `taken` layers taken: states (F,), sums (F, c), steps (F, taken)."""

    state: np.ndarray
    sums: np.ndarray
    steps: np.ndarray


def count_of(walks: Walks) -> float:
    """Return how many schedules the walks are."""
    ways = np.zeros(walks.states)
    ways[walks.first] = 1.0
    for layer in walks.layers:
        then = np.zeros(walks.states)
        np.add.at(then, layer.target, ways[layer.source])
        ways = then
    return float(ways.sum())


def tried(instance: Instance, walks: Walks, duals: list[Dual], incumbent: tuple[np.ndarray, float], gap: float) -> Explored:
    """Return the best of the walks and the incumbent: every schedule is added up, and judged where no dual's price is below the best."""
    walks = walks if walks.linked else replace(walks, layers=_sorted(walks, duals))
    duals = duals[:_PRICES]
    Y = np.stack([price_vector(dual) for dual in duals], axis=1)
    constants = constants_of(instance, duals, incumbent[1])
    ahead = walks.backward(Y)
    (chosen, value), nodes = incumbent, 0
    stack = [_Part(np.array([walks.first]), walks.base[None], np.zeros((1, 0), np.int32))]
    while stack:
        part = stack.pop()
        taken = part.steps.shape[1]
        bound = (part.sums @ Y + ahead[taken][part.state] + constants).min(axis=1)
        part = _only(part, np.flatnonzero((bound > bar(value, gap, instance)) & within_limits(instance, part.sums)), bound)
        nodes += len(part.state)
        if not len(part.state):
            continue
        if taken < len(walks.layers):
            stack += _grown(part, walks.layers[taken])
            continue
        found = schedules_of(walks, walks.layers, part.steps)
        values = instance.values(found, information_in(instance, part.sums)) - part.sums[:, -1]
        best = int(values.argmax())
        if values[best] > value:
            chosen, value = found[best], float(values[best])
    return Explored(chosen, value, bar(value, gap, instance), 0, nodes, True)


def _sorted(walks: Walks, duals: list[Dual]) -> tuple[Layer, ...]:
    """The layers whose steps differ most in price first: what is out of the question shows early."""
    y = price_vector(duals[0])
    return tuple(sorted(walks.layers, key=lambda layer: -float(np.ptp(layer.adds @ y)) if len(layer.adds) else 0.0))


def _only(part: _Part, keep: np.ndarray, bound: np.ndarray) -> _Part:
    """Some of a part, the most promising last."""
    keep = keep[np.argsort(bound[keep], kind="stable")]
    return _Part(part.state[keep], part.sums[keep], part.steps[keep])


def _grown(part: _Part, layer: Layer) -> list[_Part]:
    """Take every partial schedule one step further in each way, in parts of at most so many."""
    counts = layer.begin[part.state + 1] - layer.begin[part.state]
    size = max(1, _WIDTH // max(int(counts.max()), 1))
    found = []
    for first in range(0, len(counts), size):
        some = counts[first : first + size]
        parent = first + np.repeat(np.arange(len(some)), some)
        step = np.arange(len(parent)) - np.repeat(np.cumsum(some) - some, some) + layer.begin[part.state[parent]]
        steps = np.column_stack([part.steps[parent], step.astype(np.int32)])
        found.append(_Part(layer.target[step], part.sums[parent] + layer.adds[step], steps))
    return found
