"""Blocks: a long run is bounded by what its stretches cost at least, each for itself.

A stretch of the run that begins at its ceiling, with any choice, costs no schedule of the run less: the filter knows no more than the
ceiling, and costs are monotone. A few segments before each block cost nothing and are chosen freely: they bring the ceiling down to
what a schedule can know. Where two blocks meet each counts a share of the cost, along a ramp from all to nothing, so that the end of
the one looks at what comes after it. The sum over the blocks (the largest, where that counts) is below the cost of every schedule of
the run; it is linear in the number of segments, and what it gives away per block does not grow.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from obsdesign.selection.posterior.deepening import better_walk
from obsdesign.selection.posterior.problem import PosteriorProblem, Walk

_MARGINS = (0, 2, 4)  # segments at the ends of a block that are left as they are: what is best there looks at nothing beyond
_ALIKE = 1e-12  # of standard deviations: what is known differs by rounding alone


@dataclass(frozen=True)
class BlockLengths:
    """Lengths in segments: of a block, about; of what is before it and costs nothing; and on either side of where two meet, of the ramp."""

    length: int
    before: int
    ramp: int


def blocks(segments: int, lengths: BlockLengths) -> Iterator[tuple[int, np.ndarray]]:
    """Yield (first, weights (k,)) of stretches first..first + k - 1 whose weights sum up to 1 in each segment of the run."""
    count = max(1, round(segments / lengths.length))
    ends = np.linspace(0, segments, count + 1).round().astype(int)
    ramp = min(lengths.ramp, int(np.diff(ends).min()) // 2)
    for start, end in itertools.pairwise(ends):
        first = max(0, int(start) - (ramp + lengths.before if start else 0))
        k = np.arange(first, min(segments, end + (ramp if end < segments else 0)))
        yield first, _part_after(k, start, ramp) * (1 - _part_after(k, end, ramp) if end < segments else 1.0)


def _part_after(k: np.ndarray, start: int, ramp: int) -> np.ndarray:
    """Return how much of segments (k,) belongs to a block that begins with one, 0 to 1."""
    return np.clip((k + 0.5 - start + ramp) / (2 * ramp), 0.0, 1.0) if start and ramp else (k >= start).astype(float)


def bound_by_blocks(
    problem: PosteriorProblem,
    walk: Walk,
    lengths: BlockLengths,
    bound_of: Callable[[PosteriorProblem, np.ndarray, Walk], tuple[Walk, float]],
) -> tuple[Walk, float]:
    """Return the best schedule and the bound that blocks come to.

    bound_of: the best schedule and a bound of a stretch with weights, from that schedule's part of the best one. Parts that are better
    than those of the best schedule are tried in it, with and without their ends.
    """
    total, given = -np.inf if problem.is_worst else 0.0, walk
    for first, shares in blocks(problem.segments, lengths):
        weights = (shares > 0).astype(float) if problem.is_worst else shares
        stretch = problem.stretch(first, weights)
        part, bound = bound_of(stretch, weights, stretch.walk(walk.nodes[first : first + len(weights)]))
        total = max(total, bound) if problem.is_worst else total + bound
        free = int((weights > 0).argmax())
        walk = _with_part(problem, walk, first + free, part.nodes[free:], [lengths.ramp + margin for margin in _MARGINS])
    return better_walk(problem, given, [walk.nodes]), total


def _with_part(problem: PosteriorProblem, walk: Walk, first: int, nodes: np.ndarray, margins: Sequence[int]) -> Walk:
    """Return the best of a walk and the same with other nodes from a segment on, with and without their ends, of those within the rules."""
    last = first + len(nodes)
    tried = np.repeat(walk.nodes[None], len(margins), axis=0)
    for margin, changed in zip(margins, tried, strict=True):
        part = slice(min(margin, len(nodes)), len(nodes) - (margin if last < problem.segments else 0))
        changed[first:last][part] = nodes[part]
    follows = problem.options.follows[tried[:, :-1], tried[:, 1:]].all(axis=1) & problem.options.may_start[tried[:, 0]]
    tried = tried[follows & (tried != walk.nodes).any(axis=1)]
    candidates = [each for each in _variants(problem, walk, tried, first, last) if problem.is_feasible(each)]
    return min([walk, *candidates], key=lambda each: each.value)


def _variants(problem: PosteriorProblem, walk: Walk, tried: np.ndarray, first: int, last: int) -> list[Walk]:
    """Return walks (B, K) that differ from one in segments first..last - 1 alone, a filter followed until it knows what that one's does."""
    if not len(tried):
        return []
    P, costs, covariances = np.repeat(walk.covariances[first][:, :, None], len(tried), axis=2), [], []
    for k in range(first, problem.segments):
        if k >= last and _is_alike(P, walk.covariances[k]):
            break
        covariances.append(P.transpose(2, 0, 1))
        cost, P = problem.maps.advance(k, problem.options.pattern_of_node[tried[:, k]], P)
        costs.append(cost)
    segments, walks = slice(first, first + len(costs)), []
    for b, nodes in enumerate(tried):
        own_costs, own_covariances = walk.costs.copy(), walk.covariances.copy()
        own_costs[segments], own_covariances[segments] = [cost[b] for cost in costs], [P[b] for P in covariances]
        amounts = problem.amounts(nodes)
        total = problem.total(own_costs) + float(amounts[0])
        walks.append(Walk(nodes, total, own_costs, amounts[1:], own_covariances))
    return walks


def _is_alike(P: np.ndarray, known: np.ndarray) -> bool:
    """Whether covariances (n, n, B) are all the same as one (n, n), but for rounding."""
    deviation = np.sqrt(np.maximum(np.diag(known), 0.0))
    return bool((np.abs(P - known[:, :, None]) <= _ALIKE * (deviation[:, None] * deviation)[:, :, None]).all())
