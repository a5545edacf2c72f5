"""The observable space at a state that was asked for: there it may be less than nearby.

The rank of all derivatives is the same at all states that can be reached from one (the flow carries them over). So it is
found at a state on the way, generic among those, where a step that adds nothing ends it; and proven from the state itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import flint
from flint import arb

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.finding import Finding, StoppedBy, cut, precision_reached
from obsdesign.analysis.generic import generic_finding
from obsdesign.analysis.places import Place, Surroundings, random_fractions
from obsdesign.errors import InputError
from obsdesign.rank.balls import BALLS
from obsdesign.rank.elimination import Rank
from obsdesign.rank.taylor import Arguments

ORDERS = 40
"""No higher derivatives than this, or than 2 n + 12, are taken at a state."""
_BITS, _TERMS = 768, 40
_ERROR = arb(2) ** -480


def finding_at(equations: Equations, smooth: bool, place: Place, nearby: Finding, seed: int) -> Finding:
    """Return what is observable at the place; nearby: what is at generic states around it."""
    rank, ranks = _proven(equations, smooth, place, nearby.dimension, seed)
    if nearby.decided and rank.rank > nearby.dimension:
        why = f"nearby it is {nearby.dimension}; here a generic unknown input gives away more, a special one would not"
        return Finding(rank, place, ranks, "stalled", f"not decided: {why}")
    if rank.rank == equations.asked:
        return Finding(rank, place, ranks, "full", "no more is possible")
    if not rank.decided:
        return Finding(rank, place, ranks, "precision", precision_reached())
    if not nearby.decided:
        return Finding(rank, place, ranks, "stalled", f"not decided here, as it is nearby: {nearby.at_most}")
    if rank.rank == nearby.dimension:
        return Finding(rank, place, ranks, "cap", "no more is possible: the generic rank is the same")
    stopped_by, why = _compared(equations, smooth, place, rank, seed)
    return Finding(rank, place, ranks, stopped_by, f"{why}; nearby it is {nearby.dimension}")


def _proven(equations: Equations, smooth: bool, place: Place, goal: int, seed: int) -> tuple[Rank, tuple[int, ...]]:
    """Return the rank of derivatives at the place up to the first order that reaches the goal, and the dimensions by order."""
    ranks: list[int] = []
    rank = Experiments(equations, place, 0, seed=seed).rank(0)
    for orders in _orders(equations.n):
        experiments = Experiments(equations, place, orders, seed=seed)
        if equations.known and not smooth:
            experiments = experiments.completed()
        for order in range(len(ranks), orders + 1):
            rank = experiments.rank(order)
            ranks.append(rank.rank)
            if rank.rank >= goal and equations.unknown:
                return _looked_beyond(experiments, rank, ranks)
            if rank.rank >= goal or not rank.decided:
                return rank, tuple(ranks)
    return rank, cut(ranks)


def _looked_beyond(experiments: Experiments, rank: Rank, ranks: list[int]) -> tuple[Rank, tuple[int, ...]]:
    """Return the rank n orders later: where unknown inputs lose their effect on the outputs it may exceed what is seen nearby."""
    beyond = replace(experiments, orders=min(len(ranks) - 1 + experiments.equations.n, ORDERS))
    later = beyond.rank(beyond.orders)
    return (later, (*ranks, later.rank)) if later.rank > rank.rank else (rank, tuple(ranks))


def _orders(n: int) -> Iterator[int]:
    limit = min(2 * n + 12, ORDERS)
    orders = 2
    while orders < limit:
        yield orders
        orders *= 2
    yield limit


def _compared(equations: Equations, smooth: bool, place: Place, rank: Rank, seed: int) -> tuple[StoppedBy, str]:
    """Return whether it is as much at the place as at the states that can be reached from it, and say so."""
    most = max(_orders(equations.n))
    here = f"derivatives up to order {most} add nothing here but balls around 0, up to {rank.largest_remainder:.1e}"
    try:
        reached = reachable(equations, place, seed)
        along = generic_finding(equations, smooth, Surroundings(equations.n, seed, reached, alone=True))
    except InputError as error:
        return "stalled", f"not decided: {here} ({error})"
    if along.decided and along.dimension == rank.rank:
        return "criterion", f"no more: {here}, and no more is seen from the states that can be reached from it"
    return "stalled", f"not decided: {here}, but {along.dimension} is seen from states that can be reached from it"


def reachable(equations: Equations, place: Place, seed: int) -> Place:
    """Return a state shortly after the place on a solution with random smooth inputs, as balls that hold it."""
    with flint.ctx.workprec(_BITS):
        number = BALLS.number
        counts = {"known": len(equations.known), "unknown": len(equations.unknown)}
        inputs = {
            name: [[number(value) for value in random_fractions(_TERMS + 1, f"{seed} on the way {name} {i}")] for i in range(count)]
            for name, count in counts.items()
        }
        arguments = Arguments(
            x=[number(value) for value in place.state],
            u=inputs["known"],
            w=inputs["unknown"],
            constants=[number(value) for value in equations.values],
        )
        states = equations.flow.solution(BALLS, arguments, _TERMS)
        time = min((_time(abs(series[k]), k) for series in states for k in (_TERMS - 1, _TERMS)), default=arb(1) / 2)
        return Place(tuple(_value(series, time) for series in states))


def _time(coefficient: arb, k: int) -> arb:
    """Return the power of 2 at which the term of t^k is as small as the error allowed."""
    if coefficient <= _ERROR:
        return arb(1) / 2
    largest = (_ERROR / coefficient.abs_upper()) ** (arb(1) / k)
    return arb(2) ** ((largest.log() / arb(2).log()).floor().unique_fmpz() or -20)


def _value(series: list[arb], time: arb) -> arb:
    value = arb(0)
    for coefficient in reversed(series):
        value = value * time + coefficient
    scale = max(abs(value).abs_upper(), arb(1))
    return arb(value.mid(), (value.rad() + scale * _ERROR * 2**20).abs_upper())
