"""Blocks: a long run is bounded by what its stretches cost at least, each for itself.

A stretch of the run that begins at its ceiling, with any choice, costs no schedule of the run less: the filter knows no more than the
ceiling, and costs are monotone. A few segments before each block cost nothing and are chosen freely: they bring the ceiling down to what a
schedule can know. The sum over the blocks (the largest, where that counts) is below the cost of every schedule of the run; it is linear in
the number of segments, and what it gives away per block does not grow.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np

from obsdesign.selection.posterior.deepening import better_walk
from obsdesign.selection.posterior.problem import PosteriorProblem, Walk

_MARGINS = (0, 2, 4)  # segments at the ends of a block that are left as they are: what is best there looks at nothing beyond


def blocks(segments: int, length: int, before: int) -> Iterator[tuple[int, int, int]]:
    """Yield (first, last, free) of stretches first..last - 1 whose segments after the first `free` ones make up the run."""
    count = max(1, round(segments / length))
    ends = np.linspace(0, segments, count + 1).round().astype(int)
    for start, last in itertools.pairwise(ends):
        first = max(0, int(start) - before)
        yield first, int(last), int(start) - first


def bound_by_blocks(
    problem: PosteriorProblem, walk: Walk, length: int, before: int, bound_of: Callable[[PosteriorProblem, Walk], tuple[Walk, float]]
) -> tuple[Walk, float]:
    """Return the best schedule and the bound that blocks of about `length` segments come to.

    bound_of: the best schedule and a bound of a stretch, from that schedule's part of the best one. Parts that are better than those
    of the best schedule are tried in it, with and without their ends.
    """
    total = -np.inf if problem.is_worst else 0.0
    for first, last, free in blocks(problem.segments, length, before):
        stretch = problem.stretch(first, last, free)
        part, bound = bound_of(stretch, stretch.walk(walk.nodes[first:last]))
        total = max(total, bound) if problem.is_worst else total + bound
        for margin in _MARGINS:
            until = last - first - (margin if last < problem.segments else 0)
            walk = _with_part(problem, walk, first + free + margin, part.nodes[free + margin : until])
    return walk, total


def _with_part(problem: PosteriorProblem, walk: Walk, first: int, nodes: np.ndarray) -> Walk:
    """Return the better of a walk and the same with other nodes from a segment on, where these may follow and be followed."""
    tried = walk.nodes.copy()
    tried[first : first + len(nodes)] = nodes
    is_same = (tried == walk.nodes).all()
    is_linked = problem.options.follows[tried[:-1], tried[1:]].all() and problem.options.may_start[tried[0]]
    return better_walk(problem, walk, tried) if is_linked and not is_same else walk
