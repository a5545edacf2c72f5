"""Unknown inputs as free jets: a lower bound that grows with the order, and a second opinion on every other verdict.

dimension(K) = rank J - rank J_w with derivatives up to order K; a state is seen when its unit covector is a combination of
rows without a part in w. What it says is observable is; what it does not say may still come with a higher order, except for
known inputs that are one smooth signal (or none): there the first order that adds nothing is the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from obsdesign.analysis.engine_result import Finding, cut, precision_reached
from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import Place, Surroundings
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.modular_points import residue_place
from obsdesign.analysis.rank_growth import usable_places
from obsdesign.errors import InputError
from obsdesign.rank.elimination import Rank
from obsdesign.rank.graph import NoValueError

_SEEDS = 5  # random places tried: another one is needed only where something has no value, such as 1 / 0


def jets_finding(  # noqa: PLR0917
    equations: Equations,
    smooth: bool,
    around: Surroundings,
    enough: int,
    orders: int | None = None,
    patience: int | None = None,
    ends: bool = False,
    kept: dict[Any, Any] | None = None,
) -> Finding:
    """Return the lower bound at a generic state. It is followed to `orders`, or until it is `enough` or stands still.

    patience: so many orders without growth are a standstill (None: n); ends: a standstill proves that there is no more; kept: rows
    that were computed, see `Experiments`.
    """
    patience = patience or equations.n
    experiments, dimensions = _looked(equations, smooth, around.seed, orders, enough, patience, {} if kept is None else kept)
    reached = dimensions.index(dimensions[-1])
    bound = experiments.bound(reached)
    best: Finding | None = None
    for place in usable_places(equations, around):
        try:
            rank = replace(experiments, place=place, orders=reached).rank(reached, most=bound)
        except NoValueError:
            continue
        finding = jets_verdict(rank, place, dimensions, enough)
        if rank.decided and ends and not finding.decided:
            return replace(finding, stopped_by="bound", at_most=f"no more: {patience} = 2n + 2 orders of derivatives add nothing")
        if rank.decided:
            return finding
        best = finding if best is None or finding.dimension > best.dimension else best
    if best is None:
        raise NoValueError(0, "no random point was found where everything")
    return best


def _looked(  # noqa: PLR0917
    equations: Equations, smooth: bool, seed: int, orders: int | None, enough: int, patience: int, kept: dict[Any, Any]
) -> tuple[Experiments, tuple[int, ...]]:
    """Return the experiments modulo the prime that were followed to the end, and the dimensions by order, at most."""
    for attempt in range(_SEEDS):
        first = Experiments(equations, residue_place(equations, seed + attempt), orders or 2, seed=seed, kept=kept)
        try:
            return _followed(first, smooth) if orders else _ended(first, smooth, enough, patience)
        except ZeroDivisionError:
            continue
    raise InputError("no random point was found that is no pole of some function: give a point")


def _ended(first: Experiments, smooth: bool, enough: int, patience: int) -> tuple[Experiments, tuple[int, ...]]:
    """Return the experiments, up to the order at which the dimension is enough or has stood still, and the dimensions by order."""
    orders = first.orders
    while True:
        experiments, dimensions = _followed(replace(first, orders=orders), smooth)
        reached = dimensions.index(dimensions[-1])
        if dimensions[-1] >= enough or orders - reached >= patience:
            return experiments, dimensions
        orders = min(2 * orders, reached + patience) if orders >= patience else 2 * orders


def _followed(first: Experiments, smooth: bool) -> tuple[Experiments, tuple[int, ...]]:
    """Return as many experiments as there is something to learn from, and the dimensions by order."""
    experiments = first.completed() if first.equations.known and not smooth else first
    last = experiments.dimension(first.orders)
    dimensions: list[int] = []
    while not dimensions or dimensions[-1] < last:
        dimensions.append(experiments.dimension(len(dimensions)))
    return experiments, (*dimensions, *[last] * (first.orders + 1 - len(dimensions)))


def jets_verdict(rank: Rank, place: Place, dimensions: Sequence[int], enough: int) -> Finding:
    """Return the finding that the dimensions by order amount to."""
    n = rank.rank + rank.null_space.shape[1]
    orders = len(dimensions) - 1
    ranks = cut([min(dimension, rank.rank) for dimension in dimensions])
    if rank.rank == n:
        return Finding(rank, place, ranks, "full", "no more is possible")
    if rank.rank >= enough:
        return Finding(rank, place, ranks, "cap", "no more is possible: it is as much if the inputs are known")
    if not rank.decided:
        return Finding(rank, place, ranks, "precision", precision_reached(rank))
    what = f"a lower bound: the jets of the unknown inputs were followed to order {orders}, and a higher order may add more"
    return Finding(rank, place, ranks, "stalled", what)
