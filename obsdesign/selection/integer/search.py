"""Searching among schedules: rounding and polishing, trying all, branch and bound."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Literal

import numpy as np

from obsdesign.selection.integer.branch_and_bound import Effort, Explored, bar, explored
from obsdesign.selection.integer.enumeration import MOST, count_of, tried
from obsdesign.selection.integer.local_search import polished
from obsdesign.selection.integer.reduced_problem import Walks, nearby, walks_of
from obsdesign.selection.integer.rounding import Undecided
from obsdesign.selection.problem import Instance
from obsdesign.selection.relaxation.column_generation import Relaxed, closed

Method = Literal["auto", "columns", "direct"]

DUALS = 24  # the best of those met bound what is undecided
_FRONTS = 1000  # of the branch and bound that get duals of their own: half a minute or so
_NEAR = (40, 100)  # undecided segments of the first searches
_MANY_DIRECTIONS, _FEW_CHOICES = 80, 400
_LATEST = 12  # columns among which the best one is polished, too
_NODES = 4_000_000  # partial schedules, in place of a time, so that every machine does the same: trades patience for proofs
_OWN = 0.15  # of the time: what branch and bound has in any case, where an integer program can finish
_LISTED = 400  # choices K S, beyond which the schedules are not counted
_DRAWN = ((400, 16), (4000, 6), (40_000, 1), (1 << 62, 0))  # choices K S, and how many roundings are drawn beside the best one


@dataclass(frozen=True)
class Wanted:
    """How good, how, for how long, from which seed, and how many fronts of the branch and bound at most."""

    method: Method
    gap: float
    time_limit: float | None
    seed: int
    fronts: int = _FRONTS


@dataclass(frozen=True)
class Clock:
    """When a call began and when it ends [s], inf: never; finishes: whether something else finishes what branch and bound leaves."""

    began: float
    ends: float
    finishes: bool = False

    def left(self) -> float:
        """Return the seconds that are left."""
        return self.ends - perf_counter()

    def is_up(self) -> bool:
        """Return whether time is up."""
        return perf_counter() > self.ends

    def is_over(self) -> bool:
        """Return whether the time that branch and bound has in any case is over."""
        turn = self.began + _OWN * (self.ends - self.began) if self.finishes else self.ends
        return perf_counter() > turn

    def stalls(self, since: float, settled: float) -> bool:
        """Return whether something else should go on: with such a share done since then, not all is done in time."""
        return self.finishes and self.is_over() and perf_counter() - since > settled * (self.ends - since)


def worth_searching(instance: Instance) -> bool:
    """Whether branch and bound gets anywhere: hardly with many directions to balance in many segments, where a front takes a second."""
    return instance.rows.shape[2] * len(instance.kept) <= _MANY_DIRECTIONS or instance.shape[0] * instance.shape[1] <= _FEW_CHOICES


@dataclass(frozen=True, eq=False)
class Answer:
    """A schedule, its value, what no schedule is above, and the partial schedules that the proof looked at."""

    chosen: np.ndarray
    value: float
    bound: float
    nodes: int = 0


def incumbent(instance: Instance, found: Relaxed, whole: Undecided, wanted: Wanted, clock: Clock) -> Answer:
    """The best of the columns and of roundings of the relaxation, polished."""
    random = np.random.default_rng(wanted.seed)
    drawn = next(count for most, count in _DRAWN if np.prod(instance.shape) <= most)
    rounded = [] if instance.schedules.linked else [whole.rounded(None), *(whole.rounded(random) for _ in range(drawn))]
    nothing = np.zeros(instance.shape, dtype=bool)
    best = Answer(nothing, instance.value(nothing), found.bound)
    rounded = [each for each in rounded if instance.keeps_limits(each)]
    if drawn or not rounded:
        columns = [each.chosen for each in found.columns[-_LATEST:] if instance.keeps_limits(each.chosen)]
        rounded += sorted(columns, key=instance.value)[-1:]
    for start in rounded:
        if closed(best.value, found.bound, wanted.gap, instance) or (best.chosen.any() and clock.is_up()):
            break
        chosen, value = polished(instance, start, found.dual, found.bound)
        best = Answer(chosen, value, found.bound) if value > best.value else best
    return best


def searched(instance: Instance, found: Relaxed, answer: Answer, wanted: Wanted, clock: Clock) -> Answer:
    """Branch and bound among the schedules near the best one for the dual, which it often proves the best of these."""
    duals = [dual for dual, _ in sorted(found.met, key=lambda each: each[1])[:DUALS]]
    for count in _NEAR:
        fronts, most = 0, min(2 * count, wanted.fronts // 4)
        while fronts < most and not clock.is_over() and not closed(answer.value, answer.bound, wanted.gap, instance):
            walks = nearby(instance, found.dual, found.bound, count, bar(answer.value, wanted.gap, instance))
            if walks is None:
                break
            effort = Effort(most - fronts, _NODES, clock.is_over, lambda _: False)
            result = explored(instance, walks, duals, (answer.chosen, answer.value), wanted.gap, effort)
            fronts += max(result.fronts, 1)
            if result.value <= answer.value:
                break
            answer = _better(instance, found, result)
    return answer


def _better(instance: Instance, found: Relaxed, result: Explored) -> Answer:
    chosen, value = polished(instance, result.chosen, found.dual, found.bound)
    return Answer(chosen, value, found.bound) if value > result.value else Answer(result.chosen, result.value, found.bound)


def proven(instance: Instance, found: Relaxed, answer: Answer, wanted: Wanted, clock: Clock) -> Answer:
    """Branch and bound, anew after every better schedule."""
    duals = sorted(found.met, key=lambda each: each[1])[:DUALS]
    fronts = 0
    while not closed(answer.value, answer.bound, wanted.gap, instance):
        walks = walks_of(instance, duals, bar(answer.value, wanted.gap, instance))
        if walks is None:
            return answer
        effort = Effort(wanted.fronts - fronts, _NODES - answer.nodes, clock.is_up, partial(clock.stalls, perf_counter()))
        result = explored(instance, walks, [dual for dual, _ in duals], (answer.chosen, answer.value), wanted.gap, effort)
        fronts, nodes = fronts + result.fronts, answer.nodes + result.nodes
        if result.value <= answer.value:
            return Answer(answer.chosen, answer.value, min(result.bound, found.bound), nodes)
        answer = replace(_better(instance, found, result), nodes=nodes)
    return answer


def few(instance: Instance) -> Walks | None:
    """All schedules, where they are few enough to be tried."""
    K, S = instance.shape
    if K * S > _LISTED:
        return None
    walks = walks_of(instance, [], -np.inf)
    return walks if walks is not None and count_of(walks) <= MOST else None


def tried_all(instance: Instance, found: Relaxed, walks: Walks, answer: Answer, wanted: Wanted) -> Answer:
    """The best of all schedules that the duals leave in question."""
    if closed(answer.value, answer.bound, wanted.gap, instance):
        return answer
    best = sorted(found.met, key=lambda each: each[1])[:DUALS]
    left = walks_of(instance, best, bar(answer.value, wanted.gap, instance))
    result = tried(instance, walks if left is None else left, [dual for dual, _ in best], (answer.chosen, answer.value), wanted.gap)
    return Answer(result.chosen, result.value, min(result.bound, found.bound), result.nodes)
