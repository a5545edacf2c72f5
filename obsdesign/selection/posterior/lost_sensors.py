"""Schedules for the worst loss of sensors: the problem without each set of them, exchanges, and a bound that holds for all.

The cost of a schedule is that of its worst loss, which is no less than that of any one loss: the largest of the bounds of the problems
without one set is a bound. What one set leaves may be chosen best for that set alone, so a gap may stay however long is searched.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from obsdesign.selection.posterior.bounded_search import Answer, search
from obsdesign.selection.posterior.options import Options
from obsdesign.selection.posterior.problem import PosteriorProblem, Walk
from obsdesign.selection.posterior.questions import FilterQuestion

_MAX_SWEEPS = 2  # over all segments, of each width
_MAX_TRELLIS = 1024  # partial schedules of a trellis
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
    """Return the question without the samples of each set of so many sensors."""
    sensors = np.arange(question.arrivals.shape[1])
    works = [~np.isin(sensors, lost) for lost in combinations(sensors, robust_to)]
    return [replace(question, arrivals=question.arrivals * mask) for mask in works]


def answer_without(question: FilterQuestion, problem: PosteriorProblem, gap: float, time_limit: float | None) -> LostSet:
    """Return what the problem without a set of sensors comes to by itself."""
    is_relative = question.costs.criterion.gap_kind == "relative"
    return LostSet(question, problem, search(problem, gap, is_relative, time_limit))


def best_for_all(lost_sets: list[LostSet]) -> np.ndarray | None:
    """Return the nodes (K,) of the schedule whose worst loss costs least, of all that were looked at.

    Begins with those that were found for one set alone and with those of trellises for all, and exchanges the choices of one segment, or
    of two that follow each other, at a time. None where no schedule keeps the limits.
    """
    problems = [lost.problem for lost in lost_sets]
    starts = [lost.answer.walk.nodes for lost in lost_sets if lost.answer.walk is not None]
    if not starts:
        return None
    depths = [depth for depth in (1, 2, 3) if depth == 1 or len(problems[0].options.pattern_of_node) ** depth <= _MAX_TRELLIS]
    starts += [nodes for depth in depths for mean in _MEANS for nodes in follow_worst(problems, depth, mean)]
    walks = [_walk_all(problems, nodes) for nodes in starts]
    best = min((walk for walk in walks if problems[0].is_feasible(walk[0])), key=_worst)
    for width in (1, 2) * _MAX_SWEEPS:
        if width == 1 or problems[0].segments * len(problems[0].options.pattern_of_node) ** 2 <= _MAX_PAIRS:
            best = _sweep(problems, best, width)
    return best[0].nodes


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


def follow_worst(problems: list[PosteriorProblem], depth: int, mean: float) -> list[np.ndarray]:
    """Return the nodes (K,) that keeping the best for each choice of the last `depth` segments ends with; none at a dead end."""
    first, nodes = problems[0], len(problems[0].options.pattern_of_node)
    P0 = np.array([problem.P0[:, :, None] for problem in problems])
    costs = np.full((len(problems), 1), -np.inf if first.is_worst else 0.0)
    walks = _LossWalks(np.zeros((1, 0), dtype=int), costs, np.zeros(1), np.zeros((len(first.limits), 1)), P0)
    for k in range(first.segments):
        walks = _step(problems, walks, k)
        key = walks.choices[:, -depth:] @ nodes ** np.arange(min(depth, k + 1))
        order = np.lexsort((walks.score(mean), key))
        walks = walks.only(order[np.diff(key[order], prepend=-1) > 0])
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


def _sweep(problems: list[PosteriorProblem], walks: list[Walk], width: int) -> list[Walk]:
    """Return the walks after the choices of every `width` segments in a row were changed to the best of those that fit."""
    for k in range(problems[0].segments - width + 1):
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
