"""Trying all that is left, where that is cheaper than bounding parts of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.selection.dual import Dual
from obsdesign.selection.integer.branch_and_bound import TreeResult, cutoff, dual_constants, schedules_of, within_limits
from obsdesign.selection.integer.reduced_problem import Layer, ReducedProblem, information_of_sums, price_vector
from obsdesign.selection.problem import SelectionProblem

MAX_SCHEDULES = 1_000_000  # schedules that are tried
_CHUNK_SIZE = 16_384  # at a time
_SCREENING_DUALS = 4  # duals that are asked first, each in a few additions, whether a schedule is worth a matrix


@dataclass(frozen=True, eq=False)
class _PartialSchedules:
    """Partial schedules with the first `taken` layers taken: states (F,), sums (F, c), steps (F, taken)."""

    state: np.ndarray
    sums: np.ndarray
    steps: np.ndarray


def count_schedules(reduced: ReducedProblem) -> float:
    """Return how many schedules of the reduced problem there are."""
    counts = np.zeros(reduced.state_count)
    counts[reduced.initial_state] = 1.0
    for layer in reduced.layers:
        next_counts = np.zeros(reduced.state_count)
        np.add.at(next_counts, layer.target, counts[layer.source])
        counts = next_counts
    return float(counts.sum())


def enumerate_schedules(
    instance: SelectionProblem, reduced: ReducedProblem, duals: list[Dual], incumbent: tuple[np.ndarray, float], gap: float
) -> TreeResult:
    """Return the best of the remaining schedules and the incumbent.

    Every schedule is added up, and judged where no dual's price is below the best.
    """
    reduced = reduced if reduced.is_linked else replace(reduced, layers=_sort_layers(reduced, duals))
    duals = duals[:_SCREENING_DUALS]
    Y = np.stack([price_vector(dual) for dual in duals], axis=1)
    constants = dual_constants(instance, duals, incumbent[1])
    completion = reduced.backward_sums(Y)
    (chosen, value), nodes = incumbent, 0
    stack = [_PartialSchedules(np.array([reduced.initial_state]), reduced.base[None], np.zeros((1, 0), np.int32))]
    while stack:
        partial = stack.pop()
        depth = partial.steps.shape[1]
        bound = (partial.sums @ Y + completion[depth][partial.state] + constants).min(axis=1)
        partial = _subset(partial, np.flatnonzero((bound > cutoff(value, gap, instance)) & within_limits(instance, partial.sums)), bound)
        nodes += len(partial.state)
        if not len(partial.state):
            continue
        if depth < len(reduced.layers):
            stack += _extend(partial, reduced.layers[depth])
            continue
        schedules = schedules_of(reduced, reduced.layers, partial.steps)
        values = instance.values(schedules, information_of_sums(instance, partial.sums)) - partial.sums[:, -1]
        best = int(values.argmax())
        if values[best] > value:
            chosen, value = schedules[best], float(values[best])
    return TreeResult(chosen, value, cutoff(value, gap, instance), 0, nodes, True)


def _sort_layers(reduced: ReducedProblem, duals: list[Dual]) -> tuple[Layer, ...]:
    """The layers whose steps differ most in price first: what is out of the question shows early."""
    y = price_vector(duals[0])
    return tuple(sorted(reduced.layers, key=lambda layer: -float(np.ptp(layer.increments @ y)) if len(layer.increments) else 0.0))


def _subset(partial: _PartialSchedules, indices: np.ndarray, bound: np.ndarray) -> _PartialSchedules:
    """Some of a part, the most promising last."""
    indices = indices[np.argsort(bound[indices], kind="stable")]
    return _PartialSchedules(partial.state[indices], partial.sums[indices], partial.steps[indices])


def _extend(partial: _PartialSchedules, layer: Layer) -> list[_PartialSchedules]:
    """Take every partial schedule one step further in each way, in parts of at most so many."""
    counts = layer.offsets[partial.state + 1] - layer.offsets[partial.state]
    size = max(1, _CHUNK_SIZE // max(int(counts.max()), 1))
    extended = []
    for first in range(0, len(counts), size):
        chunk_counts = counts[first : first + size]
        parent = first + np.repeat(np.arange(len(chunk_counts)), chunk_counts)
        step = (
            np.arange(len(parent)) - np.repeat(np.cumsum(chunk_counts) - chunk_counts, chunk_counts) + layer.offsets[partial.state[parent]]
        )
        steps = np.column_stack([partial.steps[parent], step.astype(np.int32)])
        extended.append(_PartialSchedules(layer.target[step], partial.sums[parent] + layer.increments[step], steps))
    return extended
