"""A schedule and its bound: trellis, deepening, and blocks for long runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.selection.posterior.deepening import WorkLimits, prove
from obsdesign.selection.posterior.problem import PosteriorProblem, Walk
from obsdesign.selection.posterior.resource_prices import best_prices
from obsdesign.selection.posterior.trellis import follow_trellis
from obsdesign.selection.posterior.windows import first_layers

_MAX_TRELLIS = 4096  # partial schedules of a trellis
_PRICE_FACTORS = (0.0, 0.5, 1.0, 1.5)  # times the best prices of limits: with which partial schedules are compared
_EFFORT = WorkLimits(max_windows=300_000, max_simulated=1_500_000)


@dataclass(frozen=True, eq=False)
class Answer:
    """The best schedule known and a bound that no schedule is below, and what proved it; walk None: no schedule keeps the limits."""

    walk: Walk | None
    bound: float
    bound_by: str


def search(problem: PosteriorProblem, gap: float, is_relative: bool, time_limit: float | None = None) -> Answer:
    """Return the schedule and bound of a problem; gap: how near they are wanted, as a share of the cost where is_relative."""
    walk = first_walk(problem)
    if walk is None:
        return Answer(None, np.inf, "no schedule keeps the limits")
    proof = prove(problem, walk, gap * abs(walk.value) if is_relative else gap, _EFFORT)
    return Answer(proof.walk, proof.bound, f"windows of {proof.depth} segments")


def first_walk(problem: PosteriorProblem) -> Walk | None:
    """Return the best walk of trellises of growing depth, with several prices where something is limited in sum."""
    best, nodes = None, len(problem.options.pattern_of_node)
    prices = trellis_prices(problem)
    for depth in (1, 2, 3):
        if depth > 1 and nodes**depth > _MAX_TRELLIS:
            break
        for price in prices:
            walk = follow_trellis(problem, depth, price)
            if walk is not None and (best is None or walk.value < best.value):
                best = walk
    return best


def trellis_prices(problem: PosteriorProblem) -> list[np.ndarray]:
    """Return the prices (R,) that partial schedules are compared with."""
    limits = problem.options.limits
    if not len(limits):
        return [np.zeros(0)]
    layers = first_layers(problem)
    if problem.is_worst:
        level = float(np.median(np.concatenate([layer.cost for layer in layers])))
        unit = np.full(len(limits), level) / np.maximum(limits, problem.options.usage.max(initial=1e-9, axis=(1, 2)))
    else:
        unit = best_prices(problem, layers)
    return [factor * unit for factor in (_PRICE_FACTORS if unit.any() else (0.0,))]
