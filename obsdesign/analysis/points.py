"""The observable space at a state that was asked for: there it may be less than nearby.

With known inputs alone the rank of all derivatives is the same at all states that can be reached from one (the flow carries
them over). So it is found at a state on the way, generic among those, where a step that adds nothing ends it; and proven from
the state itself. Unknown inputs are first replaced by what the outputs give away of them, where that is regular at the state.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from obsdesign.analysis.equations import Equations, with_input_states
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.finding import Finding, StoppedBy, cut, precision_reached, thin_balls
from obsdesign.analysis.generic import LEVELS, space_at
from obsdesign.analysis.growth import generic_growth, growth_at, ranks_at, require_one_piece, require_value
from obsdesign.analysis.orbit import reachable
from obsdesign.analysis.places import Place, Surroundings, random_fractions
from obsdesign.analysis.rescaled import Rescaled, rescale
from obsdesign.analysis.words import Space, TooLargeError
from obsdesign.errors import InputError
from obsdesign.rank.elimination import Rank
from obsdesign.rank.graph import NoValueError

ORDERS = 40
"""No higher derivatives than this, or than 2 n + 12, are taken at a state."""


def finding_at(equations: Equations, smooth: bool, place: Place, nearby: Finding, seed: int) -> Finding:
    """Return what is observable at the place; nearby: what is at generic states. Raises NoValueError where derivatives have no value."""
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
    return cap.dimension if cap.decided else equations.n


def _known(equations: Equations, place: Place, seed: int) -> Finding:
    """Return what is observable at the place with known inputs alone."""
    n = equations.asked
    nearby = generic_growth(equations, Surroundings(n, seed, _asked(equations, place)))
    proven = _proven(equations, False, place, nearby.total if nearby.decided else equations.n, seed)
    rank, ranks = proven.rank, proven.dimensions
    if rank.rank == n and rank.decided:
        return Finding(rank, place, ranks, "full", "no more is possible")
    if not rank.decided:
        return Finding(rank, place, ranks, "precision", precision_reached())
    total = proven.total
    if nearby.decided and total == nearby.total:
        return Finding(rank, place, ranks, "cap", "no more is possible: the generic rank is the same")
    stopped_by, why = _compared(equations, place, rank, total, seed)
    return Finding(rank, place, ranks, stopped_by, f"{why}; nearby it is {nearby.dimension}")


def _asked(equations: Equations, place: Place) -> Place:
    """Return the part of the place without the added states."""
    return Place(place.state[equations.extra :])


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
    around = Surroundings(equations.asked, seed, _asked(equations, place))
    for near in around.places(equations.extra):
        try:
            require_value(equations, near)
            require_one_piece(equations, around, near)
            rescaled = rescale(space_at(equations, near, around), everywhere=True)
            return rescaled.regular_at(Space(equations, place)) if rescaled else None
        except TooLargeError:
            return None
        except (NoValueError, ZeroDivisionError):
            continue
    return None


def _by_regularity(equations: Equations, place: Place, cap: int, seed: int) -> Finding | None:
    """Return what is observable under one smooth input where the ranks of J and J_w are, order by order, those of states nearby.

    The spaces P_k then have the same dimensions at the place as around it, so they end where they do. None where they differ.
    """
    nearby = generic_growth(equations, Surroundings(equations.n, seed, place))
    orders = min(nearby.order + 1 + equations.n, ORDERS)
    here, there = (Experiments(equations, each, orders, seed=seed) for each in (place, nearby.place))
    if not nearby.decided or any(here.pattern(order) != there.pattern(order) for order in range(orders + 1)):
        return None
    rank = here.rank(orders)
    if not rank.decided or rank.rank != nearby.dimension:
        return None
    why = f"no more: derivatives up to order {orders} have the same ranks here as nearby, where those of order {nearby.order} add nothing"
    return _limited(Finding(rank, place, cut(nearby.dimensions), "cap", why), cap)


def _by_jets(equations: Equations, smooth: bool, place: Place, cap: int, seed: int, orders: int | None = None) -> Finding:
    """Return the lower bound by derivatives at the place, decided where it is as much as with the inputs known."""
    proven = _proven(equations, smooth, place, cap, seed, orders)
    rank, ranks = proven.rank, proven.dimensions
    if rank.decided and rank.rank == equations.n:
        return Finding(rank, place, ranks, "full", "no more is possible")
    if rank.decided and rank.rank == cap:
        return Finding(rank, place, ranks, "cap", "no more is possible: it is as much if the inputs are known")
    order = orders or max(_orders(equations.n))
    why = f"a lower bound: derivatives were followed to order {order}, and a higher order may add more"
    return Finding(rank, place, ranks, "stalled", f"not decided: {why}")


class _Proven(NamedTuple):
    """The rank at a place, the dimensions by order, and the rank with the added states."""

    rank: Rank
    dimensions: tuple[int, ...]
    total: int


def _proven(equations: Equations, smooth: bool, place: Place, goal: int, seed: int, orders: int | None = None) -> _Proven:
    """Return what derivatives at the place show, up to the first order that reaches the goal."""
    ranks: list[int] = []
    rank, total = _ranks_of(Experiments(equations, place, 0, seed=seed), 0, confirmed=True)
    steps = (orders,) if orders else tuple(_orders(equations.n))
    for highest in steps:
        experiments = Experiments(equations, place, highest, seed=seed)
        if equations.known and not smooth:
            experiments = experiments.completed()
        for order in range(len(ranks), highest + 1):
            rank, total = _ranks_of(experiments, order, confirmed=False)
            ended = total >= goal or rank.rank == equations.asked or not rank.decided
            if ended or order == steps[-1]:
                rank, total = _ranks_of(experiments, order, confirmed=True)
            ranks.append(rank.rank)
            if total >= goal or rank.rank == equations.asked or not rank.decided:
                return _Proven(rank, tuple(ranks), total)
    return _Proven(rank, cut(ranks), total)


def _ranks_of(experiments: Experiments, order: int, *, confirmed: bool) -> tuple[Rank, int]:
    rank, total = ranks_at(experiments, order, confirmed=confirmed)
    return rank, total.rank


def _orders(n: int) -> Iterator[int]:
    """Yield 2, 4, 8, ... up to the highest order of derivatives that is taken at a state."""
    limit = min(2 * n + 12, ORDERS)
    orders = 2
    while orders < limit:
        yield orders
        orders *= 2
    yield limit


def _compared(equations: Equations, place: Place, rank: Rank, total: int, seed: int) -> tuple[StoppedBy, str]:
    """Return whether it is as much at the place as at the states that can be reached from it, and say so."""
    here = f"derivatives up to order {max(_orders(equations.n))} add nothing here {thin_balls(rank)}"
    try:
        along = growth_at(equations, reachable(equations, place, seed), seed)
    except InputError as error:
        return "stalled", f"not decided: {here} ({error})"
    if along.decided and along.total == total:
        return "criterion", f"no more: {here}, and no more is seen from the states that can be reached from it"
    return "stalled", f"not decided: {here}, but {along.dimension} is seen from states that can be reached from it"
