"""Unknown inputs as free jets: a lower bound that grows with the order, and a second opinion on every other verdict.

dimension(K) = rank J - rank J_w with derivatives up to order K; a state is seen when its unit covector is a combination of
rows without a part in w. What it says is observable is; what it does not say may still come with a higher order, except for
known inputs that are one smooth signal (or none): there the first order that adds nothing is the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.finding import Finding, cut
from obsdesign.analysis.places import Place, Surroundings, modular_place
from obsdesign.rank.elimination import Rank
from obsdesign.rank.graph import NoValueError


def jets_finding(equations: Equations, smooth: bool, around: Surroundings, enough: int, orders: int | None = None) -> Finding:
    """Return the lower bound at a generic state; enough: no more is possible; orders: None = until it stands still for n orders."""
    modular = equations.is_rational and not around.alone
    found = jets_at(equations, smooth, modular_place(equations.n, around.seed), around.seed, enough, orders) if modular else None
    for place in around.places(equations.extra):
        try:
            experiments, dimensions = found or jets_at(equations, smooth, place, around.seed, enough, orders)
            labels = experiments.independent(experiments.orders) if modular else None
            rank = replace(experiments, place=place).rank(experiments.orders, labels)
        except NoValueError:
            continue
        return jets_verdict(rank, place, dimensions, enough)
    raise NoValueError(0, "no random point was found where everything")


def jets_at(
    equations: Equations, smooth: bool, place: Place, seed: int, enough: int, orders: int | None = None
) -> tuple[Experiments, tuple[int, ...]]:
    """Return the experiments and their dimensions by order; it ends with `enough`, with `orders`, or n orders without growth."""
    n = equations.asked
    highest = 2 if orders is None else orders
    while True:
        experiments = Experiments(equations, place, highest, seed=seed)
        if equations.known and not smooth:
            experiments = experiments.completed()
        dimensions = _dimensions(experiments)
        growth_ended = dimensions.index(dimensions[-1])
        if dimensions[-1] >= enough or orders is not None or highest - growth_ended > n:
            return experiments, dimensions
        highest *= 2


def _dimensions(experiments: Experiments) -> tuple[int, ...]:
    orders = range(experiments.orders + 1)
    if experiments.place.modular:
        return tuple(experiments.dimension(order) for order in orders)
    return tuple(experiments.rank(order).rank for order in orders)


def jets_verdict(rank: Rank, place: Place, dimensions: Sequence[int], enough: int) -> Finding:
    """Return the finding that the dimensions by order amount to."""
    n = rank.rank + rank.null_space.shape[1]
    orders = len(dimensions) - 1
    ranks = cut(dimensions)
    if rank.rank == n:
        return Finding(rank, place, ranks, "full", "no more is possible")
    if rank.rank >= enough:
        return Finding(rank, place, ranks, "cap", "no more is possible: it is as much if the inputs are known")
    what = f"a lower bound: the jets of the unknown inputs were followed to order {orders}, and a higher order may add more"
    return Finding(rank, place, ranks, "stalled", what)
