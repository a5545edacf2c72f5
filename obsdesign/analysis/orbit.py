"""A state on the way: shortly after a state on a solution with random smooth inputs, generic among those that can be reached."""

from __future__ import annotations

import flint
from flint import arb

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.growth import require_value
from obsdesign.analysis.places import Place, Surroundings, random_fractions
from obsdesign.errors import InputError
from obsdesign.rank.balls import BALLS
from obsdesign.rank.graph import NoValueError
from obsdesign.rank.taylor import Arguments

_BITS, _TERMS, _ERROR = 1024, 40, arb(2) ** -960
"""A state on the way is known to _ERROR, from so many terms, so ranks there are taken with so many bits."""
_HALVINGS = 60


def reachable(equations: Equations, place: Place, seed: int) -> Place:
    """Return a state shortly after the place on a solution with random smooth inputs, as balls that hold it."""
    with flint.ctx.workprec(2 * _BITS):
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
        time = min(arb(1) / 2, *(_time(abs(series[k]), k) for series in states for k in range(_TERMS - 7, _TERMS + 1)))
        time = time * (1 + abs(random_fractions(1, f"{seed} time")[0].numerator / arb(2**20))) / 2
        for _ in range(_HALVINGS):
            reached = Place(tuple(_value(series, time) for series in states), precisions=(_BITS,))
            try:
                require_value(equations, Surroundings(equations.n, seed, place).box(reached))
            except NoValueError:
                time = time / 2  # a kink may lie on the way
                continue
            return reached
    raise InputError(f"no state was found that is reached from {equations.where(place)} without a kink or a pole nearby")


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
