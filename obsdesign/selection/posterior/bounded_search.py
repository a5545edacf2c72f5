"""A schedule and its bound: trellis, deepening, and blocks for long runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.selection.posterior.deepening import WorkLimits, prove
from obsdesign.selection.posterior.problem import PosteriorProblem, Walk
from obsdesign.selection.posterior.trellis import follow_trellis

_MAX_TRELLIS = 4096  # partial schedules of a trellis
_EFFORT = WorkLimits(max_windows=300_000, max_simulated=1_500_000)


@dataclass(frozen=True, eq=False)
class Answer:
    """The best schedule known and a bound that no schedule is below, and what proved it; walk None: no schedule keeps the limits."""

    walk: Walk | None
    bound: float
    bound_by: str


def search(problem: PosteriorProblem, gap: float, is_relative: bool) -> Answer:
    """Return the schedule and bound of a problem; gap: how near they are wanted, as a share of the cost where is_relative."""
    walk = first_walk(problem)
    if walk is None:
        return Answer(None, np.inf, "no schedule keeps the limits")
    proof = prove(problem, walk, gap * abs(walk.value) if is_relative else gap, _EFFORT)
    return Answer(proof.walk, proof.bound, f"windows of {proof.depth} segments")


def first_walk(problem: PosteriorProblem) -> Walk | None:
    """Return the best walk of trellises of growing depth."""
    best, nodes = None, len(problem.options.pattern_of_node)
    for depth in (1, 2, 3):
        if depth > 1 and nodes**depth > _MAX_TRELLIS:
            break
        walk = follow_trellis(problem, depth, np.zeros(len(problem.options.limits)))
        if walk is not None and (best is None or walk.value < best.value):
            best = walk
    return best
