"""The observable space at a state that was asked for: there it may be less than nearby.

With known inputs alone the rank of all derivatives is the same at all states that can be reached from one (the flow carries
them over). At least so much is proven from the state itself, or from a state on the way; at most so much by the generic rank, or
by that on a set that the state cannot leave. Unknown inputs are first replaced by what the outputs give away of them, where that
is regular at the state.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from obsdesign.analysis.engine_result import Finding, cut, how, precision_reached
from obsdesign.analysis.equations import Equations, with_input_states
from obsdesign.analysis.evaluation_point import Place, Surroundings, random_fractions
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.field_rescaling import Rescaled, rescale
from obsdesign.analysis.generic_rank import LEVELS, cap_of, without_idle_inputs, witness_of
from obsdesign.analysis.invariant_set import growth_on_invariant
from obsdesign.analysis.lie_expressions import Space, TooLargeError
from obsdesign.analysis.modular_points import residue_place, residues_of
from obsdesign.analysis.orbit import carried_rank
from obsdesign.analysis.rank_growth import Bounds, growth_modulo
from obsdesign.errors import InputError
from obsdesign.rank.balls import PRECISIONS
from obsdesign.rank.elimination import Bound, Rank
from obsdesign.rank.graph import NoValueError

ORDERS = 40
"""No higher derivatives than this, or than 2 n + 12, are taken at a state."""
_FINER = (8192, 16384, 32768, 65536)
"""Precisions beyond the usual ones, tried where that is cheap."""
_CHEAP = 4e9
"""Bits times operations."""


def finding_at(equations: Equations, smooth: bool, place: Place, nearby: Finding, seed: int) -> Finding:
    """Return what is observable at the place; nearby: what is at generic states. Raises NoValueError where derivatives have no value."""
    if equations.known and equations.unknown and not smooth:
        equations = without_idle_inputs(equations, Surroundings(equations.asked, seed, place))
    if not equations.unknown:
        return _known(equations, place, seed)
    cap = _cap(equations, place, seed)
    found = _by_rescaling(equations, smooth, place, cap, seed)
    if found is None and (smooth or not equations.known):
        found = _by_regularity(equations, place, cap, seed)
    if found is None or found.dimension > min(cap, nearby.dimension if nearby.decided else cap):
        return _by_jets(equations, smooth, place, cap, seed)
    # the steps are those of the recursion, where it comes to the same end
    return replace(found, ranks=nearby.ranks) if found.dimension == nearby.dimension else found


def jets_at(equations: Equations, smooth: bool, place: Place, seed: int, orders: int | None = None) -> Finding:
    """Return the lower bound by derivatives at the place, up to `orders`."""
    return _by_jets(equations, smooth, place, _cap(equations, place, seed), seed, orders)


def _cap(equations: Equations, place: Place, seed: int) -> int:
    """Return the dimension at the place for somebody who knows the unknown inputs; n where that is not decided."""
    cap = _known(equations.with_all_known(), place, seed)
    return cap.dimension if cap.decided else min(equations.asked, cap_of(equations, Surroundings(equations.asked, seed)))


def _known(equations: Equations, place: Place, seed: int) -> Finding:
    """Return what is observable at the place with known inputs alone."""
    n = equations.asked
    nearby = growth_modulo(equations, seed)
    proven = _proven(equations, False, place, nearby.total, seed)
    rank, ranks = proven.rank, proven.dimensions
    if rank.rank == n:
        return Finding(rank, place, ranks, "full", "no more is possible")
    if rank.decided and proven.total == nearby.total:
        return Finding(rank, place, ranks, "cap", "no more is possible: the generic rank is the same")
    if not rank.decided and proven.at_most > rank.rank:
        why = f"{precision_reached(rank)}, and at most {proven.at_most} {how(equations.is_rational)}"
        return Finding(rank, place, ranks, "precision", why)
    within = growth_on_invariant(equations, place, seed)
    if within and rank.decided and within.total == proven.total:
        return Finding(rank, place, ranks, "criterion", f"no more: {_held(equations)}; nearby it is {nearby.dimension}")
    return _on_the_way(equations, place, proven, nearby, within, seed)


def _held(equations: Equations) -> str:
    return f"no solution leaves a set at whose random states no more is seen {how(equations.is_rational)}"


def _on_the_way(equations: Equations, place: Place, proven: _Proven, nearby: Bounds, within: Bounds | None, seed: int) -> Finding:
    """Return what a state on the way shows, where that is as much as there can be."""
    orders = max(_orders(equations.n))
    here = f"derivatives up to order {orders} add nothing here"
    why = f"not decided: {here}; on a set that no solution leaves it is at most {(within or nearby).dimension}"
    stalled = Finding(proven.rank, place, proven.dimensions, "stalled", why)
    if equations.extra:
        return stalled
    goal = within or nearby
    most = Bound(goal.dimension, 0, None)
    rank = carried_rank(equations, place, len(goal.dimensions), proven.count, most, seed)
    if rank is None or rank.rank < proven.rank.rank:
        return stalled
    shown_too = rank.exact or all(shown for seen, shown in zip(rank.seen, proven.rank.seen, strict=True) if seen)
    if not rank.decided or not shown_too:  # what seems to be seen by itself is to be proven to be
        return replace(stalled, rank=rank)
    ranks = (*proven.dimensions, *[rank.rank] * (proven.dimensions[-1] < rank.rank))
    shown = "shown by a state on the way, and the flow carries it over"
    if rank.rank == equations.n:
        return Finding(rank, place, ranks, "full", f"{shown}; no more is possible")
    if rank.rank == nearby.dimension:
        return Finding(rank, place, ranks, "cap", f"{shown}; no more is possible: the generic rank is the same")
    return Finding(rank, place, ranks, "criterion", f"{shown}; no more: {_held(equations)}; nearby it is {nearby.dimension}")


def _by_rescaling(equations: Equations, smooth: bool, place: Place, cap: int, seed: int) -> Finding | None:
    """Return what is observable where the outputs give all unknown inputs away at the place itself; None where they do not.

    As at generic states, unknown inputs become states where the outputs give only their derivatives away.
    """
    for level in range(LEVELS + 1):
        extended = with_input_states(equations, level) if level else equations
        there = Place((*random_fractions(extended.extra, f"{seed} unknown inputs"), *place.state))
        try:
            rescaled = _regular(extended, smooth, there, seed)
            found = _rescaled_finding(rescaled, smooth, there, cap, seed) if rescaled else None
        except InputError:
            continue
        if found:
            return replace(found, place=place)
    return None


def _rescaled_finding(rescaled: Rescaled, smooth: bool, place: Place, cap: int, seed: int) -> Finding | None:
    """Return what is observable at the place by the question with known inputs that the rescaled system asks; None if undecided."""
    if smooth or not rescaled.equations.known:
        found = _known(rescaled.smooth_equations(), place, seed)
        return _limited(_explained(found), cap) if found.decided else None
    told = _known(rescaled.known_equations(rescaled.switched_rates), place, seed)
    if told.decided and told.dimension < cap:
        above = _known(rescaled.known_equations(rescaled.switched_rates, rescaled.tensor), place, seed)
        if not above.decided or above.dimension > told.dimension:
            return None
    return _limited(_explained(told), cap) if told.decided else None


def _explained(finding: Finding) -> Finding:
    return replace(finding, at_most=f"with the unknown inputs replaced by rates of outputs {finding.at_most}")


def _limited(finding: Finding, cap: int) -> Finding:
    """Return the finding with the reason that holds for the system with its unknown inputs."""
    if finding.stopped_by == "full":
        return finding
    if finding.dimension == cap:
        return replace(finding, stopped_by="cap", at_most="no more is possible: it is as much if the inputs are known")
    return finding


def _regular(equations: Equations, smooth: bool, place: Place, seed: int) -> Rescaled | None:
    """Return the rescaled system if it is regular at the place.

    Under one smooth known input outputs are not redefined: of a derivative along u and drift only the sum is known.
    """
    if smooth and equations.known:
        return Rescaled(equations, equations.outputs, equations.outputs).regular_at(Space(equations, place))
    try:
        around = Surroundings(equations.asked, seed, Place(place.state[equations.extra :]))
        space = Space(equations, residue_place(equations, seed), witness_of(equations, around))
        rescaled = rescale(space, everywhere=True)
        return rescaled.regular_at(Space(equations, place)) if rescaled else None
    except (TooLargeError, NoValueError, ZeroDivisionError):
        return None


def _by_regularity(equations: Equations, place: Place, cap: int, seed: int) -> Finding | None:
    """Return what is observable under one smooth input where the ranks of J and J_w are, order by order, those of states nearby.

    The spaces P_k then have the same dimensions at the place as around it, so they end where they do. None where they differ.
    """
    nearby = growth_modulo(equations, seed)
    added = len(nearby.dimensions) - 1
    orders = min(added + 1 + equations.n, ORDERS)
    here = Experiments(equations, place, orders, seed=seed)
    there = replace(here, place=nearby.place)
    for order in range(orders + 1):
        if not all(here.reaches(order, there.bound(order, columns)) for columns in (0, here.inputs)):
            return None
    rank = here.rank(orders, most=replace(here, place=residues_of(equations, place.state)).bound(orders))
    if not rank.decided or rank.rank != nearby.dimension:
        return None
    why = f"no more: derivatives up to order {orders} have the same ranks here as nearby, where those of order {added} add nothing"
    return _limited(Finding(rank, place, cut(nearby.dimensions), "cap", why), cap)


def _by_jets(equations: Equations, smooth: bool, place: Place, cap: int, seed: int, orders: int | None = None) -> Finding:
    """Return the lower bound by derivatives at the place, decided where it is as much as with the inputs known."""
    proven = _proven(equations, smooth, place, cap, seed, orders)
    rank, ranks = proven.rank, proven.dimensions
    if rank.rank == equations.n:
        return Finding(rank, place, ranks, "full", "no more is possible")
    if rank.rank == cap:
        return Finding(rank, place, ranks, "cap", "no more is possible: it is as much if the inputs are known")
    order = orders or max(_orders(equations.n))
    why = f"a lower bound: derivatives were followed to order {order}, and a higher order may add more"
    return Finding(rank, place, ranks, "stalled", f"not decided: {why}")


@dataclass(frozen=True, eq=False)
class _Proven:
    """The rank at a place, the dimensions by order, and the rank with the added states; count: of experiments.

    at_most: what the rank of these derivatives is at most.
    """

    rank: Rank
    dimensions: tuple[int, ...]
    total: int
    at_most: int
    count: int


def _proven(equations: Equations, smooth: bool, place: Place, goal: int, seed: int, orders: int | None = None) -> _Proven:
    """Return what derivatives at the place show, up to the first order that reaches the goal, or else adds nothing."""
    experiments, dimensions = _followed(equations, smooth, place, goal, seed, orders)
    order = len(dimensions) - 1
    real = replace(experiments, place=_finer(equations, place, order), orders=order)
    same = replace(experiments, orders=order)
    bound = same.bound(order)
    rank = real.rank(order, most=bound)
    total = real.rank(order, most=same.bound(order, same.inputs), eliminated=same.inputs).rank if equations.extra else rank.rank
    ranks = cut([min(dimension, rank.rank) for dimension in dimensions])
    return _Proven(rank, ranks, total, bound.rank, experiments.count)


def _followed(
    equations: Equations, smooth: bool, place: Place, goal: int, seed: int, orders: int | None
) -> tuple[Experiments, tuple[int, ...]]:
    """Return experiments at the place modulo the prime, and the dimensions that they show by order, to the last that adds something."""
    there = residues_of(equations, place.state)
    dimensions: list[int] = []
    totals: list[int] = []
    experiments = Experiments(equations, there, 0, seed=seed)
    for highest in (orders,) if orders else tuple(_orders(equations.n)):
        experiments = Experiments(equations, there, highest, seed=seed)
        if equations.known and not smooth:
            experiments = experiments.completed()
        for order in range(len(dimensions), highest + 1):
            dimensions.append(experiments.dimension(order))
            totals.append(experiments.total(order))
            if totals[-1] >= goal or dimensions[-1] == equations.asked:
                return experiments, tuple(dimensions)
    last = max(each.index(each[-1]) for each in (dimensions, totals))
    return experiments, tuple(dimensions[: last + 1])


def _finer(equations: Equations, place: Place, order: int) -> Place:
    """Return the place with finer precisions, as far as they are cheap."""
    n = equations.n
    operations = (order + 1) ** 2 * (len(equations.flow.steps) + n * n * (n + len(equations.unknown) * order))
    return replace(place, precisions=(*PRECISIONS, *(bits for bits in _FINER if bits * operations <= _CHEAP)))


def _orders(n: int) -> Iterator[int]:
    """Yield 2, 4, 8, ... up to the highest order of derivatives that is taken at a state."""
    limit = min(2 * n + 12, ORDERS)
    orders = 2
    while orders < limit:
        yield orders
        orders *= 2
    yield limit
