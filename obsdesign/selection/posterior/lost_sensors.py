"""Schedules for the worst loss of sensors: the problem without each set of them, exchanges, and a bound that holds for all.

The cost of a schedule is that of its worst loss, which is no less than that of any one loss: the largest of the bounds of the problems
without one set is a bound. What one set leaves may be chosen best for that set alone, so a gap may stay however long is searched.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb

import numpy as np

from obsdesign.errors import InputError
from obsdesign.selection.posterior.bounded_search import Answer, search
from obsdesign.selection.posterior.deadline import Deadline
from obsdesign.selection.posterior.few_schedules import all_tried, best_of_few, few_walks
from obsdesign.selection.posterior.filter_certificate import (
    TIME_WAS_UP,
    accuracy_for,
    certified_bound,
    certify,
    status_of_gap,
    with_note,
)
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.posterior.formulation import problem_of
from obsdesign.selection.posterior.options import Options
from obsdesign.selection.posterior.problem import PosteriorProblem, Walk
from obsdesign.selection.posterior.questions import FilterQuestion
from obsdesign.selection.posterior.trellis import best_by_key
from obsdesign.status import Status

_MAX_SWEEPS = 2  # over all segments, of each width
_MAX_SETS = 500  # of sensors that may be lost together
_MAX_TRELLIS = 1024  # partial schedules of a trellis
_MAX_STEPS = 500_000  # of one trellis, and of one sweep of exchanges: simulated in all, for all losses
_OF_EACH = 0.6  # of the time left: what searches for one loss each may take, the rest is for schedules for all
_MAX_PAIRS = 2000  # changes of two segments in a row: K A^2 at most
_MEANS = (0.0, 0.3, 1.0)  # of the mean over the losses: how partial schedules are compared beside the largest cost
_AHEAD = 10  # segments: how far a changed choice is followed before it is judged in full


@dataclass(frozen=True, eq=False)
class LostSet:
    """What is left without a set of sensors: the question, its problem, and its own schedule and bound."""

    question: FilterQuestion
    problem: PosteriorProblem
    answer: Answer


def questions_without(question: FilterQuestion, robust_to: int) -> list[FilterQuestion]:
    """Return the question without the samples of each set of so many sensors; raise InputError where these are too many."""
    sensors = np.arange(question.arrivals.shape[1])
    count = comb(len(sensors), robust_to)
    if count > _MAX_SETS:
        raise InputError(f"robust_to is {robust_to}: {count} sets of {len(sensors)} sensors may be lost, at most {_MAX_SETS} are accepted")
    works = [~np.isin(sensors, lost) for lost in combinations(sensors, robust_to)]
    return [replace(question, arrivals=question.arrivals * mask) for mask in works]


def solve_for_losses(
    sets: list[FilterQuestion], problem: PosteriorProblem, *, gap: float, deadline: Deadline, starts: Sequence[np.ndarray]
) -> FilterSchedule | None:
    """Return the schedule for the worst of the questions without a set of sensors, compared with nothing; None: none keeps the limits.

    problem: with all sensors, of which the rules count; starts: walks (K,) to be no worse than.
    """
    lost_sets = _search_each(sets, problem, gap, starts)
    nodes = best_for_all(lost_sets, problem.deadline)
    if nodes is None:
        return None
    bounds = [_bound_of(lost, nodes) for lost in lost_sets]
    by = f"one loss of {len(sets)} at a time, {lost_sets[int(np.argmax(bounds))].answer.bound_by}"
    is_cut, last = problem.deadline.is_over, replace(problem, deadline=deadline)
    record = _certify_worst(sets, last, nodes, max(bounds), by, gap)
    if record.gap <= gap:
        return record
    best, all_of_few = _best_of_few(sets, problem, deadline)
    if best is not None:
        return _certify_worst(sets, last, best, np.inf, all_of_few, gap)
    return with_note(record, TIME_WAS_UP) if is_cut and record.status is Status.GAP_OPEN else record


def _bound_of(lost: LostSet, nodes: np.ndarray) -> float:
    """Return the bound of one loss alone, less what rounding may have added to it, as it shows in a schedule (K,)."""
    value = lost.question.schedule_cost(lost.problem.options.chosen(nodes)) + lost.problem.switching(nodes)
    return certified_bound(lost.question, lost.answer.bound, value, lost.problem.walk(nodes).value)


def _certify_worst(
    sets: list[FilterQuestion], problem: PosteriorProblem, nodes: np.ndarray, bound: float, by: str, gap: float
) -> FilterSchedule:
    """Return the record of a schedule (K,) under its worst loss and a bound."""
    chosen = problem.options.chosen(nodes)
    question = max(sets, key=lambda part: part.schedule_cost(chosen))
    own = problem if problem.deadline.is_over else problem_of(question, problem.options, problem.deadline)
    record = certify(question, own, own.walk(nodes), Answer(None, np.inf, by, is_exact=True), gap=gap)
    bound = min(bound, record.value)
    remaining = question.gap_between(record.value, bound)
    return replace(record, bound=bound, gap=remaining, status=status_of_gap(remaining, gap))


def _best_of_few(sets: list[FilterQuestion], problem: PosteriorProblem, deadline: Deadline) -> tuple[np.ndarray | None, str]:
    """Return the nodes (K,) of the best of few schedules, None where they are not few, and what proves it."""
    few = few_walks(problem.options, len(sets) * sets[0].path.steps)
    best = best_of_few(problem.options, few, lambda chosen: max(part.schedule_cost(chosen) for part in sets), deadline)
    return best, all_tried(few)


def _search_each(sets: list[FilterQuestion], problem: PosteriorProblem, gap: float, starts: Sequence[np.ndarray]) -> list[LostSet]:
    """Return what the problem without each set of sensors comes to by itself, with its share of the work and of the time."""
    done = []
    for i, question in enumerate(sets):
        if done and problem.deadline.is_over:
            break
        part = problem_of(question, problem.options, problem.deadline.share(_OF_EACH / (len(sets) - i)))
        least_costs = question.least_costs(problem.options.may_be_on)
        answer = search(part, accuracy_for(gap), question.is_relative, starts, least_costs, share=1 / len(sets))
        done.append(LostSet(question, part, answer))
    return done


def best_for_all(lost_sets: list[LostSet], deadline: Deadline) -> np.ndarray | None:
    """Return the nodes (K,) of the schedule whose worst loss costs least, of all that were looked at until a deadline.

    Begins with those that were found for one set alone and with those of trellises for all, and exchanges the choices of one segment, or
    of two that follow each other, at a time. None where no schedule keeps the limits.
    """
    problems = [lost.problem for lost in lost_sets]
    starts = [lost.answer.walk.nodes for lost in lost_sets if lost.answer.walk is not None]
    if not starts:
        return None
    walks = [_walk_all(problems, nodes) for nodes in _different([*starts, *_trellises(problems, deadline)])]
    best = min((walk for walk in walks if problems[0].is_feasible(walk[0])), key=_worst)
    changes = problems[0].segments * len(problems[0].options.pattern_of_node)
    widths = (1, 2) if changes * len(problems[0].options.pattern_of_node) <= _MAX_PAIRS else (1,)
    if changes * len(problems) * _AHEAD > _MAX_STEPS:
        return best[0].nodes
    for width in widths * _MAX_SWEEPS:
        best = _sweep(problems, best, width, deadline)
    return best[0].nodes


def _different(walks: list[np.ndarray]) -> list[np.ndarray]:
    return list({nodes.tobytes(): nodes for nodes in walks}.values())


def _trellises(problems: list[PosteriorProblem], deadline: Deadline) -> Iterator[np.ndarray]:
    """Yield the nodes (K,) of trellises for all losses at once, deeper and deeper ones."""
    nodes = len(problems[0].options.pattern_of_node)
    width = max(1, int(_MAX_STEPS / (problems[0].segments * nodes * len(problems))))
    for depth in (1, 2, 3):
        for mean in _MEANS:
            if deadline.is_over or (depth > 1 and nodes**depth > _MAX_TRELLIS):
                return
            yield from follow_worst(problems, depth, mean, width, deadline)


@dataclass(frozen=True, eq=False)
class _LossWalks:
    """Partial walks under L losses: choices (B, k), costs (L, B), switching (B,), usage (R, B), P (L, n, n, B)."""

    choices: np.ndarray
    costs: np.ndarray
    switching: np.ndarray
    usage: np.ndarray
    P: np.ndarray

    def only(self, index: np.ndarray) -> _LossWalks:
        """Return some of them."""
        return _LossWalks(self.choices[index], self.costs[:, index], self.switching[index], self.usage[:, index], self.P[..., index])

    def score(self, mean: float) -> np.ndarray:
        """Return the largest cost (B,) with so much of the mean over the losses."""
        return self.costs.max(axis=0) + mean * self.costs.mean(axis=0) + (1 + mean) * self.switching


def follow_worst(problems: list[PosteriorProblem], depth: int, mean: float, width: int, deadline: Deadline) -> list[np.ndarray]:
    """Return the nodes (K,) that keeping the best for each choice of the last `depth` segments ends with; none at a dead end.

    Of more than `width` the best are kept, one from when the deadline is over.
    """
    first, nodes = problems[0], len(problems[0].options.pattern_of_node)
    P0 = np.array([problem.P0[:, :, None] for problem in problems])
    costs = np.full((len(problems), 1), -np.inf if first.is_worst else 0.0)
    walks = _LossWalks(np.zeros((1, 0), dtype=int), costs, np.zeros(1), np.zeros((len(first.limits), 1)), P0)
    for k in range(first.segments):
        walks = _step(problems, walks, k)
        key = walks.choices[:, -depth:] @ nodes ** np.arange(min(depth, k + 1))
        walks = walks.only(best_by_key(key, walks.score(mean), 1 if deadline.is_over else width))
    return [walks.choices[int(walks.score(0.0).argmin())]] if len(walks.choices) else []


def _step(problems: list[PosteriorProblem], walks: _LossWalks, k: int) -> _LossWalks:
    """Return all walks that go on into segment k within the limits."""
    options = problems[0].options
    last = walks.choices[:, -1] if k else np.array([-1] * len(walks.choices))
    parent, node = np.nonzero(np.vstack([options.follows, options.may_start])[last] & options.allowed[k])
    steps = [problem.advance(k, last[parent], node, P[..., parent]) for problem, P in zip(problems, walks.P, strict=True)]
    costs = [problems[0].combine(so_far[parent], cost) for so_far, (cost, _, _) in zip(walks.costs, steps, strict=True)]
    amounts = steps[0][1]
    longer = _LossWalks(
        np.concatenate([walks.choices[parent], node[:, None]], axis=1),
        np.array(costs),
        walks.switching[parent] + amounts[0],
        walks.usage[:, parent] + amounts[1:],
        np.array([P for _, _, P in steps]),
    )
    return longer.only(np.flatnonzero((longer.usage <= problems[0].limits[:, None]).all(axis=0)))


def _walk_all(problems: list[PosteriorProblem], nodes: np.ndarray) -> list[Walk]:
    return [problem.walk(nodes) for problem in problems]


def _worst(walks: list[Walk]) -> float:
    return max(walk.value for walk in walks)


def _sweep(problems: list[PosteriorProblem], walks: list[Walk], width: int, deadline: Deadline) -> list[Walk]:
    """Return the walks after the choices of every `width` segments in a row were changed to the best of those that fit."""
    for k in range(problems[0].segments - width + 1):
        if deadline.is_over:
            break
        changes = _alternatives(problems[0].options, walks[0].nodes, k, width)
        costs = np.max([_estimate(problem, walk, k, changes) for problem, walk in zip(problems, walks, strict=True)], axis=0)
        changed = walks[0].nodes.copy()
        changed[k : k + width] = changes[int(costs.argmin())]
        candidate = _walk_all(problems, changed)
        if problems[0].is_feasible(candidate[0]) and _worst(candidate) < _worst(walks):
            walks = candidate
    return walks


def _alternatives(options: Options, nodes: np.ndarray, k: int, width: int) -> np.ndarray:
    """Return nodes (B, width) that may stand in segments from k on, those that stand there among them."""
    fits = np.flatnonzero(options.allowed[k] & (options.follows[nodes[k - 1]] if k else options.may_start))[:, None]
    for j in range(k + 1, k + width):
        parent, node = np.nonzero(options.follows[fits[:, -1]] & options.allowed[j])
        fits = np.concatenate([fits[parent], node[:, None]], axis=1)
    return fits if k + width == len(nodes) else fits[options.follows[fits[:, -1], nodes[k + width]]]


def _estimate(problem: PosteriorProblem, walk: Walk, k: int, changes: np.ndarray) -> np.ndarray:
    """Return what walks with other nodes (B, width) from segment k on cost, what they change followed for a while; limits left out."""
    K, count, end = problem.segments, len(changes), min(problem.segments, k + _AHEAD)
    P = np.repeat(walk.covariances[k][:, :, None], count, axis=2)
    nodes = np.repeat(walk.nodes[None, k:end], count, axis=0)
    nodes[:, : changes.shape[1]] = changes
    before, total, switching = np.full(count, walk.nodes[k - 1] if k else -1), np.full(count, -np.inf if problem.is_worst else 0.0), 0.0
    for j, node in enumerate(nodes.T, k):
        cost, amounts, P = problem.advance(j, before, node, P)
        before, total, switching = node, problem.combine(total, cost), switching + amounts[0]
    rest = np.concatenate([walk.costs[:k], walk.costs[end:K]])
    if len(rest):
        total = problem.combine(total, np.array(rest.max() if problem.is_worst else rest.sum()))
    return total + switching
