"""Searching among schedules: rounding and polishing, trying all, branch and bound."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Literal

import numpy as np

from obsdesign.selection.integer.branch_and_bound import TreeLimits, TreeResult, cutoff, explore_tree
from obsdesign.selection.integer.enumeration import MAX_SCHEDULES, count_schedules, enumerate_schedules
from obsdesign.selection.integer.local_search import improve_by_exchange
from obsdesign.selection.integer.reduced_problem import ReducedProblem, neighbourhood_problem, reduce_problem
from obsdesign.selection.integer.rounding import FractionalSchedule
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column_generation import RelaxedSolution, is_gap_closed

Method = Literal["auto", "columns", "direct"]

DUALS = 24  # the best of those met bound what is undecided
_MAX_BATCHES = 1000  # of the branch and bound that get duals of their own: half a minute or so
_NEIGHBOURHOODS = (40, 100)  # undecided segments of the first searches
_MANY_DIRECTIONS, _FEW_CHOICES = 80, 400
_LATEST_COLUMNS = 12  # columns among which the best one is polished, too
_MAX_NODES = 4_000_000  # partial schedules, in place of a time, so that every machine does the same: trades patience for proofs
_SEARCH_TIME_SHARE = 0.15  # of the time: what branch and bound has in any case, where an integer program can finish
_MAX_CHOICES_LISTED = 400  # choices K S, beyond which the schedules are not counted
_ROUNDING_DRAWS = ((400, 16), (4000, 6), (40_000, 1), (1 << 62, 0))  # choices K S, and how many roundings are drawn beside the best one


@dataclass(frozen=True)
class SelectionOptions:
    """How good, how, for how long, from which seed, and how many fronts of the branch and bound at most."""

    method: Method
    gap: float
    time_limit: float | None
    seed: int
    max_batches: int = _MAX_BATCHES


@dataclass(frozen=True)
class Clock:
    """When a call began and when it ends [s], inf: never; has_finisher: whether something else finishes what branch and bound leaves."""

    start: float
    deadline: float
    has_finisher: bool = False

    def seconds_left(self) -> float:
        """Return the seconds that are left."""
        return self.deadline - perf_counter()

    def is_up(self) -> bool:
        """Return whether time is up."""
        return perf_counter() > self.deadline

    def is_search_over(self) -> bool:
        """Return whether the time that branch and bound has in any case is over."""
        search_deadline = self.start + _SEARCH_TIME_SHARE * (self.deadline - self.start) if self.has_finisher else self.deadline
        return perf_counter() > search_deadline

    def stalls(self, since: float, fathomed: float) -> bool:
        """Return whether something else should go on: with such a share done since then, not all is done in time."""
        return self.has_finisher and self.is_search_over() and perf_counter() - since > fathomed * (self.deadline - since)


def is_tractable(instance: SelectionProblem) -> bool:
    """Whether branch and bound gets anywhere: hardly with many directions to balance in many segments, where a front takes a second."""
    return (
        instance.block_vectors.shape[2] * len(instance.working_sensors) <= _MANY_DIRECTIONS
        or instance.shape[0] * instance.shape[1] <= _FEW_CHOICES
    )


@dataclass(frozen=True, eq=False)
class Incumbent:
    """A schedule, its value, what no schedule is above, and the partial schedules that the proof looked at."""

    chosen: np.ndarray
    value: float
    bound: float
    nodes: int = 0


def find_incumbent(
    instance: SelectionProblem, relaxation: RelaxedSolution, fractional: FractionalSchedule, options: SelectionOptions, clock: Clock
) -> Incumbent:
    """The best of the columns and of roundings of the relaxation, polished."""
    random = np.random.default_rng(options.seed)
    draws = next(count for limit, count in _ROUNDING_DRAWS if np.prod(instance.shape) <= limit)
    starts = (
        [] if instance.schedules.is_linked else [fractional.round_shares(None), *(fractional.round_shares(random) for _ in range(draws))]
    )
    empty = np.zeros(instance.shape, dtype=bool)
    best = Incumbent(empty, instance.value(empty), relaxation.bound)
    starts = [schedule for schedule in starts if instance.is_within_limits(schedule)]
    if draws or not starts:
        columns = [column.chosen for column in relaxation.columns[-_LATEST_COLUMNS:] if instance.is_within_limits(column.chosen)]
        starts += sorted(columns, key=instance.value)[-1:]
    for start in starts:
        if is_gap_closed(best.value, relaxation.bound, options.gap, instance) or (best.chosen.any() and clock.is_up()):
            break
        chosen, value = improve_by_exchange(instance, start, relaxation.dual, relaxation.bound)
        best = Incumbent(chosen, value, relaxation.bound) if value > best.value else best
    return best


def search_neighbourhoods(
    instance: SelectionProblem, relaxation: RelaxedSolution, incumbent: Incumbent, options: SelectionOptions, clock: Clock
) -> Incumbent:
    """Branch and bound among the schedules near the best one for the dual, which it often proves the best of these."""
    duals = [dual for dual, _ in sorted(relaxation.evaluated_duals, key=lambda pair: pair[1])[:DUALS]]
    for count in _NEIGHBOURHOODS:
        batches, batch_limit = 0, min(2 * count, options.max_batches // 4)
        while (
            batches < batch_limit
            and not clock.is_search_over()
            and not is_gap_closed(incumbent.value, incumbent.bound, options.gap, instance)
        ):
            reduced = neighbourhood_problem(
                instance, relaxation.dual, relaxation.bound, count, cutoff(incumbent.value, options.gap, instance)
            )
            if reduced is None:
                break
            limits = TreeLimits(batch_limit - batches, _MAX_NODES, clock.is_search_over, lambda _: False)
            result = explore_tree(instance, reduced, duals, (incumbent.chosen, incumbent.value), options.gap, limits)
            batches += max(result.batches, 1)
            if result.value <= incumbent.value:
                break
            incumbent = _improve(instance, relaxation, result)
    return incumbent


def _improve(instance: SelectionProblem, relaxation: RelaxedSolution, result: TreeResult) -> Incumbent:
    chosen, value = improve_by_exchange(instance, result.chosen, relaxation.dual, relaxation.bound)
    return Incumbent(chosen, value, relaxation.bound) if value > result.value else Incumbent(result.chosen, result.value, relaxation.bound)


def prove_optimality(
    instance: SelectionProblem, relaxation: RelaxedSolution, incumbent: Incumbent, options: SelectionOptions, clock: Clock
) -> Incumbent:
    """Branch and bound, anew after every better schedule."""
    duals = sorted(relaxation.evaluated_duals, key=lambda pair: pair[1])[:DUALS]
    batches = 0
    while not is_gap_closed(incumbent.value, incumbent.bound, options.gap, instance):
        reduced = reduce_problem(instance, duals, cutoff(incumbent.value, options.gap, instance))
        if reduced is None:
            return incumbent
        limits = TreeLimits(options.max_batches - batches, _MAX_NODES - incumbent.nodes, clock.is_up, partial(clock.stalls, perf_counter()))
        result = explore_tree(instance, reduced, [dual for dual, _ in duals], (incumbent.chosen, incumbent.value), options.gap, limits)
        batches, nodes = batches + result.batches, incumbent.nodes + result.nodes
        if result.value <= incumbent.value:
            return Incumbent(incumbent.chosen, incumbent.value, min(result.bound, relaxation.bound), nodes)
        incumbent = replace(_improve(instance, relaxation, result), nodes=nodes)
    return incumbent


def enumerable_problem(instance: SelectionProblem) -> ReducedProblem | None:
    """All schedules, where they are few enough to be tried."""
    K, S = instance.shape
    if K * S > _MAX_CHOICES_LISTED:
        return None
    reduced = reduce_problem(instance, [], -np.inf)
    return reduced if reduced is not None and count_schedules(reduced) <= MAX_SCHEDULES else None


def enumerate_all(
    instance: SelectionProblem, relaxation: RelaxedSolution, all_schedules: ReducedProblem, incumbent: Incumbent, options: SelectionOptions
) -> Incumbent:
    """The best of all schedules that the duals leave in question."""
    if is_gap_closed(incumbent.value, incumbent.bound, options.gap, instance):
        return incumbent
    duals = sorted(relaxation.evaluated_duals, key=lambda pair: pair[1])[:DUALS]
    reduced = reduce_problem(instance, duals, cutoff(incumbent.value, options.gap, instance))
    result = enumerate_schedules(
        instance,
        all_schedules if reduced is None else reduced,
        [dual for dual, _ in duals],
        (incumbent.chosen, incumbent.value),
        options.gap,
    )
    return Incumbent(result.chosen, result.value, min(result.bound, relaxation.bound), result.nodes)
