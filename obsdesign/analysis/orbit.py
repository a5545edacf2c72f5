"""A state on the way: shortly after a state on its solution under known inputs held at random values, as balls that hold it.

The flow carries the rank of all derivatives over: what is proven there is proven at the state. x(h) = sum_k x_k h^k + R h^(N+1), k <= N,
where R is the coefficient N + 1 at any state of a box that the solution does not leave before h: one that holds x(0) + [0, h] rate(box).
Source: R. Moore, Interval Analysis, 1966, section 11; R. Lohner, 1987.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import flint
from flint import arb, arb_mat

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import Place, random_fractions
from obsdesign.analysis.experiments import Experiments
from obsdesign.rank.balls import BALLS, is_finite
from obsdesign.rank.elimination import Bound, Rank, rank_of
from obsdesign.rank.exact_numbers import as_ball
from obsdesign.rank.graph import NoValueError
from obsdesign.rank.taylor import Arguments, Flow

_BITS, _TERMS, _ERROR = 1024, 40, arb(2) ** -600
_HALVINGS = 80  # of a step, from the reach of its series: where 2^-80 of it is too long to enclose the flow, none is tried any more
_STEPS = 2  # away from the point, along its orbit, with inputs drawn anew; each costs a series of the flow in balls


def carried_rank(equations: Equations, place: Place, order: int, count: int, most: Bound, seed: int) -> Rank | None:
    """Return the rank at the place that derivatives up to the order show at a state on the way, in terms of changes at the place.

    It is decided where it is what it is at most. None where no such state was found.
    """
    state: Sequence[arb] = [as_ball(value) for value in place.state]
    with flint.ctx.workprec(_BITS):
        state = [as_ball(value) for value in place.state]
        carried = BALLS.matrix(len(state), len(state), [arb(int(i == j)) for i in range(len(state)) for j in range(len(state))])
        for step in range(_STEPS):
            moved = _moved(equations, state, f"{seed} on the way {step}")
            if moved is None:
                return None
            state, change = moved
            carried = change * carried
    there = Experiments(equations, Place(tuple(state), precisions=(_BITS,)), order, count, seed)

    def rows() -> list[list[arb]]:
        return (arb_mat(there.rows()) * carried).tolist()

    try:
        return rank_of(rows, equations.n - equations.extra, equations.extra, precisions=(_BITS,), most=most)
    except NoValueError:
        return None


def _moved(equations: Equations, state: Sequence[arb], seed: str) -> tuple[list[arb], arb_mat] | None:
    """Return the state after a step with constant inputs and its derivative by the state (n, n), as balls that hold them."""
    n = equations.n
    inputs = [[as_ball(value)] for value in random_fractions(len(equations.known), seed)]
    constants = [as_ball(value) for value in equations.values]
    flow = equations.flow

    def arguments(x: Sequence[arb]) -> Arguments:
        return Arguments(x, [[value[0], *[arb(0)] * (_TERMS + 1)] for value in inputs], [], constants)

    step = _power_of_2(min((_reach(series) for series in flow.solution(BALLS, arguments(state), _TERMS)), default=arb(1)))
    for _ in range(_HALVINGS):
        box = _box(flow, arguments, state, step)
        if box is not None:
            series = flow.solution(BALLS, arguments(state), _TERMS)
            rest = flow.solution(BALLS, arguments(box), _TERMS + 1)
            if all(is_finite(each[-1]) for each in rest):
                reached = [_sum([*own, other[-1]], step) for own, other in zip(series, rest, strict=True)]
                own = replace(flow, h=flow.x).sensitivities(BALLS, arguments(state), _TERMS)
                change = [_sum([each[i, j] for each in own], step) for i in range(n) for j in range(n)]
                return reached, arb_mat(n, n, change)
        step = step / 2
    return None


def _box(flow: Flow, arguments, state: Sequence[arb], step: arb) -> list[arb] | None:  # noqa: ANN001
    """Return states that the solution does not leave during the step; None where these are none."""
    rates = [series[1] for series in flow.solution(BALLS, arguments(state), 1)]
    box = [value + arb(0, (2 * step * rate).abs_upper() + _ERROR) for value, rate in zip(state, rates, strict=True)]
    within = [series[1] for series in flow.solution(BALLS, arguments(box), 1)]
    if not all(is_finite(rate) for rate in within):
        return None
    ahead = arb(0).union(step)
    held = all((each + ahead * rate) in outer for each, rate, outer in zip(state, within, box, strict=True))
    return box if held else None


def _reach(series: Sequence[arb]) -> arb:
    """Return the step at which the term of the highest order is as small as the error allowed."""
    last = max((abs(coefficient).abs_upper() for coefficient in series[-4:]), default=arb(0))
    if not last.is_finite() or last <= _ERROR:
        return arb(1) / 4
    return (_ERROR / last) ** (arb(1) / len(series))


def _power_of_2(value: arb) -> arb:
    """Return a power of 2 below the value, at most 1/4."""
    exponent = (value.abs_lower().log() / arb(2).log()).floor().unique_fmpz()
    return arb(2) ** min(int(exponent) if exponent is not None else -20, -2)


def _sum(series: Sequence[arb], step: arb) -> arb:
    value = arb(0)
    for coefficient in reversed(series):
        value = value * step + coefficient
    return value
