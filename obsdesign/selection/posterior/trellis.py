"""Good schedules: forward, for every choice of the last few segments the best partial schedule is kept with its own covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.selection.posterior.problem import PosteriorProblem

_MAX_ENTRIES = 1_500_000  # numbers of the covariances that go on into a segment from partial schedules
_MAX_WORK = 120e6  # times `step_size`: steps of a trellis in all
_TIE_BREAK = 1e-3  # of a segment's cost: where the largest counts, equals differ by what else they cost


@dataclass(frozen=True, eq=False)
class Steps:
    """Steps into a segment: which partial walk (B,) goes on with which node (B,), and what it will have used (R, B)."""

    parent: np.ndarray
    node: np.ndarray
    usage: np.ndarray

    def only(self, index: np.ndarray) -> Steps:
        """Return some of them."""
        return Steps(self.parent[index], self.node[index], self.usage[:, index])


@dataclass(frozen=True, eq=False)
class PartialWalks:
    """Walks up to a segment: the last node (B,), the sum of costs and switching (B,), the largest cost (B,), usage (R, B), P (n, n, B)."""

    node: np.ndarray
    total: np.ndarray
    largest: np.ndarray
    usage: np.ndarray
    P: np.ndarray

    def advance(
        self, steps: Steps, index: np.ndarray, cost: np.ndarray, switching: np.ndarray, P: np.ndarray, is_worst: bool
    ) -> PartialWalks:
        """Return the walks that some of the steps make of these, with what all of them cost and end with."""
        parent = steps.parent[index]
        return PartialWalks(
            steps.node[index],
            self.total[parent] + switching[index] + (0.0 if is_worst else cost[index]),
            np.maximum(self.largest[parent], cost[index]),
            steps.usage[:, index],
            P[:, :, index],
        )

    def value(self, is_worst: bool) -> np.ndarray:
        """Return the objective (B,) of what has been walked."""
        return self.total + (self.largest if is_worst else 0.0)


def start_of(problem: PosteriorProblem, count: int) -> PartialWalks:
    """Return so many walks before the first segment, at the node -1: what was on."""
    usage = np.zeros((len(problem.options.limits), count))
    P = np.repeat(problem.P0[:, :, None], count, axis=2)
    return PartialWalks(np.full(count, -1), np.zeros(count), np.full(count, -np.inf), usage, P)


def successors(problem: PosteriorProblem, walks: PartialWalks, k: int, rest: np.ndarray) -> Steps:
    """Return all steps into segment k after which the limits can still be kept; rest: `smallest_rest`."""
    options = problem.options
    may_follow = np.vstack([options.follows, options.may_start])[walks.node] & options.allowed[k]
    parent, node = np.nonzero(may_follow)
    usage = walks.usage[:, parent] + options.usage[:, k, node] + options.start_usage[:, walks.node[parent], node]
    can_end = (usage + rest[:-1, k, node] <= options.limits[:, None]).all(axis=0) & np.isfinite(rest[-1, k, node])
    return Steps(parent[can_end], node[can_end], usage[:, can_end])


def follow_trellis(problem: PosteriorProblem, depth: int, prices: np.ndarray, width: int) -> np.ndarray | None:
    """Return the walk (K,) that keeping the best for every choice of the last `depth` segments ends with; None where none keeps the limits.

    prices (R,): what a unit of each resource counts while partial schedules are compared; of more than `width` the best are kept,
    one from when the deadline is over.
    """
    options, rest = problem.options, smallest_rest(problem)
    stages, key, walks = [], np.zeros(1, dtype=np.int64), start_of(problem, 1)
    for k in range(problem.segments):
        steps = successors(problem, walks, k, rest)
        if not len(steps.node):
            return None
        cost, P = problem.maps.advance(k, options.pattern_of_node[steps.node], walks.P[:, :, steps.parent])
        switching = problem.switching_costs(k, walks.node[steps.parent], steps.node)
        walks = walks.advance(steps, np.arange(len(cost)), cost, switching, P, problem.is_worst)
        score = walks.value(problem.is_worst) + prices @ walks.usage + (_TIE_BREAK * cost if problem.is_worst else 0.0)
        key = (key[steps.parent] * len(options.pattern_of_node) + steps.node) % len(options.pattern_of_node) ** depth
        best = best_by_key(key, score, 1 if problem.deadline.is_over else width)
        stages.append((steps.parent[best], steps.node[best]))
        key = key[best]
        walks = PartialWalks(walks.node[best], walks.total[best], walks.largest[best], walks.usage[:, best], walks.P[:, :, best])
    return backtrack(stages, int(walks.value(problem.is_worst).argmin()))


def trellis_width(problem: PosteriorProblem, share: float) -> int:
    """Return how many partial schedules a trellis may keep with a share of the work of one."""
    nodes = len(problem.options.pattern_of_node)
    held = _MAX_ENTRIES / (nodes * len(problem.P0) ** 2)
    return max(1, int(share * min(held, _MAX_WORK / (problem.segments * nodes * problem.step_size))))


def first_by_key(key: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Return the place of the lowest score (B,) for each key (B,) >= 0, by key."""
    order = np.lexsort((score, key))
    return order[np.diff(key[order], prepend=-1) > 0]


def best_by_key(key: np.ndarray, score: np.ndarray, width: int) -> np.ndarray:
    """Return the place of the lowest score (B,) for each key (B,), by key; of more than `width` the lowest."""
    best = first_by_key(key, score)
    return best if len(best) <= width else np.sort(best[np.argsort(score[best], kind="stable")[:width]])


def backtrack(stages: list[tuple[np.ndarray, np.ndarray]], index: int) -> np.ndarray:
    """Return the nodes (K,) that lead to a place in the last of K stages, each the place before and the node of its members (B,)."""
    nodes = np.empty(len(stages), dtype=int)
    for k in range(len(stages) - 1, -1, -1):
        parent, node = stages[k]
        nodes[k], index = node[index], int(parent[index])
    return nodes


def smallest_rest(problem: PosteriorProblem) -> np.ndarray:
    """Return the least of each resource (R + 1, K, A) that is still needed after a node in a segment, last a count of nothing.

    inf where no walk goes on to the end.
    """
    options, K, A = problem.options, problem.segments, len(problem.options.pattern_of_node)
    usage = np.concatenate([options.usage, np.zeros((1, K, A))])
    starts = np.concatenate([options.start_usage[:, :-1], np.zeros((1, A, A))])
    rest = np.zeros((len(usage), K, A))
    for k in range(K - 1, 0, -1):
        steps = starts + (usage[:, k] + rest[:, k])[:, None, :]
        rest[:, k - 1] = np.where(options.follows & options.allowed[k], steps, np.inf).min(axis=2)
    return rest
