"""Unknown inputs as free jets: a lower bound that grows with the order, and a second opinion on every other verdict.

dimension(K) = rank J - rank J_w with derivatives up to order K; a state is seen when its unit covector is a combination of
rows without a part in w. What it says is observable is; what it does not say may still come with a higher order, except for
known inputs that are one smooth signal (or none): there the first order that adds nothing is the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from obsdesign.analysis.engine_result import EngineResult, cut_after_growth, precision_text
from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import EvaluationPoint, SamplingRegion
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.modular_points import random_modular_point
from obsdesign.analysis.rank_growth import usable_points
from obsdesign.errors import InputError
from obsdesign.rank.elimination import Rank
from obsdesign.rank.graph import NoValueError

_ATTEMPTS = 5  # random places tried: another one is needed only where something has no value, such as 1 / 0


def jets_result(  # noqa: PLR0917
    equations: Equations,
    smooth: bool,
    region: SamplingRegion,
    target: int,
    orders: int | None = None,
    patience: int | None = None,
    standstill_proves: bool = False,
    row_cache: dict[Any, Any] | None = None,
) -> EngineResult:
    """Return the lower bound at a generic state. It is followed to `orders`, or until it is `target` or stands still.

    patience: so many orders without growth are a standstill (None: n); standstill_proves: a standstill proves that there is no more;
    row_cache: rows that were computed, see `Experiments`.
    """
    patience = patience or equations.n
    experiments, dimensions = _explore_orders(
        equations, smooth, region.seed, orders, target, patience, {} if row_cache is None else row_cache
    )
    last_growth = dimensions.index(dimensions[-1])
    bound = experiments.bound(last_growth)
    best: EngineResult | None = None
    for point in usable_points(equations, region):
        try:
            rank = replace(experiments, point=point, orders=last_growth).rank(last_growth, upper_bound=bound)
        except NoValueError:
            continue
        result = classify_jets(rank, point, dimensions, target)
        if rank.is_decided and standstill_proves and not result.is_decided:
            return replace(result, stopped_by="bound", reason=f"no more: {patience} = 2n + 2 orders of derivatives add nothing")
        if rank.is_decided:
            return result
        best = result if best is None or result.dimension > best.dimension else best
    if best is None:
        raise NoValueError(0, "no random point was found where everything")
    return best


def _explore_orders(  # noqa: PLR0917
    equations: Equations, smooth: bool, seed: int, orders: int | None, target: int, patience: int, row_cache: dict[Any, Any]
) -> tuple[Experiments, tuple[int, ...]]:
    """Return the experiments modulo the prime that were followed to the end, and the dimensions by order, at most."""
    for attempt in range(_ATTEMPTS):
        first = Experiments(equations, random_modular_point(equations, seed + attempt), orders or 2, seed=seed, row_cache=row_cache)
        try:
            return _dimensions_by_order(first, smooth) if orders else _follow_until_standstill(first, smooth, target, patience)
        except ZeroDivisionError:
            continue
    raise InputError("no random point was found that is no pole of some function: give a point")


def _follow_until_standstill(first: Experiments, smooth: bool, target: int, patience: int) -> tuple[Experiments, tuple[int, ...]]:
    """Return the experiments, up to the order at which the dimension is enough or has stood still, and the dimensions by order."""
    orders = first.orders
    while True:
        experiments, dimensions = _dimensions_by_order(replace(first, orders=orders), smooth)
        last_growth = dimensions.index(dimensions[-1])
        if dimensions[-1] >= target or orders - last_growth >= patience:
            return experiments, dimensions
        orders = min(2 * orders, last_growth + patience) if orders >= patience else 2 * orders


def _dimensions_by_order(first: Experiments, smooth: bool) -> tuple[Experiments, tuple[int, ...]]:
    """Return as many experiments as there is something to learn from, and the dimensions by order."""
    experiments = first.complete() if first.equations.known_fields and not smooth else first
    final = experiments.dimension(first.orders)
    dimensions: list[int] = []
    while not dimensions or dimensions[-1] < final:
        dimensions.append(experiments.dimension(len(dimensions)))
    return experiments, (*dimensions, *[final] * (first.orders + 1 - len(dimensions)))


def classify_jets(rank: Rank, point: EvaluationPoint, dimensions: Sequence[int], target: int) -> EngineResult:
    """Return the finding that the dimensions by order amount to."""
    n = rank.rank + rank.null_space.shape[1]
    orders = len(dimensions) - 1
    ranks = cut_after_growth([min(dimension, rank.rank) for dimension in dimensions])
    if rank.rank == n:
        return EngineResult(rank, point, ranks, "full", "no more is possible")
    if rank.rank >= target:
        return EngineResult(rank, point, ranks, "cap", "no more is possible: it is as much if the inputs are known")
    if not rank.is_decided:
        return EngineResult(rank, point, ranks, "precision", precision_text(rank))
    what = f"a lower bound: the jets of the unknown inputs were followed to order {orders}, and a higher order may add more"
    return EngineResult(rank, point, ranks, "stalled", what)
