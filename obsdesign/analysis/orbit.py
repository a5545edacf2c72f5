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
from obsdesign.analysis.evaluation_point import EvaluationPoint, random_fractions
from obsdesign.analysis.experiments import Experiments
from obsdesign.rank.balls import BALLS, is_finite
from obsdesign.rank.elimination import Rank, RankBound, rank_of
from obsdesign.rank.exact_numbers import as_ball
from obsdesign.rank.graph import NoValueError
from obsdesign.rank.taylor import Flow, FlowArguments

_BITS, _TERMS, _MAX_ERROR = 1024, 40, arb(2) ** -600
_HALVINGS = 80  # of a step, from the reach of its series: where 2^-80 of it is too long to enclose the flow, none is tried any more
_N_STEPS = 2  # away from the point, along its orbit, with inputs drawn anew; each costs a series of the flow in balls


def rank_along_orbit(
    equations: Equations, point: EvaluationPoint, order: int, count: int, upper_bound: RankBound, seed: int
) -> Rank | None:
    """Return the rank at the place that derivatives up to the order show at a state on the way, in terms of changes at the place.

    It is decided where it is what it is at most. None where no such state was found.
    """
    state: Sequence[arb] = [as_ball(value) for value in point.state]
    with flint.ctx.workprec(_BITS):
        state = [as_ball(value) for value in point.state]
        transition = BALLS.matrix(len(state), len(state), [arb(int(i == j)) for i in range(len(state)) for j in range(len(state))])
        for step in range(_N_STEPS):
            taylor_step = _taylor_step(equations, state, f"{seed} on the way {step}")
            if taylor_step is None:
                return None
            state, change = taylor_step
            transition = change * transition
    experiments = Experiments(equations, EvaluationPoint(tuple(state), precisions=(_BITS,)), order, count, seed)

    def rows_at_start() -> list[list[arb]]:
        """Return J about the start of the orbit, at the working precision."""
        return (arb_mat(experiments.rows()) * transition).tolist()

    try:
        return rank_of(rows_at_start, equations.n - equations.n_added, equations.n_added, precisions=(_BITS,), upper_bound=upper_bound)
    except NoValueError:
        return None


def _taylor_step(equations: Equations, state: Sequence[arb], seed: str) -> tuple[list[arb], arb_mat] | None:
    """Return the state after a step with constant inputs and its derivative by the state (n, n), as balls that hold them."""
    n = equations.n
    inputs = [[as_ball(value)] for value in random_fractions(len(equations.known_fields), seed)]
    constants = [as_ball(value) for value in equations.values]
    flow = equations.differential_flow

    def arguments(x: Sequence[arb]) -> FlowArguments:
        """Return the arguments of the flow from x, its inputs constant."""
        return FlowArguments(x, [[value[0], *[arb(0)] * (_TERMS + 1)] for value in inputs], [], constants)

    step = _power_of_2(min((_step_size(series) for series in flow.solution(BALLS, arguments(state), _TERMS)), default=arb(1)))
    for _ in range(_HALVINGS):
        enclosure = _enclosure(flow, arguments, state, step)
        if enclosure is not None:
            series = flow.solution(BALLS, arguments(state), _TERMS)
            remainders = flow.solution(BALLS, arguments(enclosure), _TERMS + 1)
            if all(is_finite(coefficients[-1]) for coefficients in remainders):
                next_state = [
                    _horner([*known_terms, remainder[-1]], step) for known_terms, remainder in zip(series, remainders, strict=True)
                ]
                sensitivities = replace(flow, h=flow.x).sensitivities(BALLS, arguments(state), _TERMS)
                change = [_horner([matrix[i, j] for matrix in sensitivities], step) for i in range(n) for j in range(n)]
                return next_state, arb_mat(n, n, change)
        step = step / 2
    return None


def _enclosure(flow: Flow, arguments, state: Sequence[arb], step: arb) -> list[arb] | None:  # noqa: ANN001
    """Return states that the solution does not leave during the step; None where these are none."""
    rates = [series[1] for series in flow.solution(BALLS, arguments(state), 1)]
    enclosure = [value + arb(0, (2 * step * rate).abs_upper() + _MAX_ERROR) for value, rate in zip(state, rates, strict=True)]
    rates_in_enclosure = [series[1] for series in flow.solution(BALLS, arguments(enclosure), 1)]
    if not all(is_finite(rate) for rate in rates_in_enclosure):
        return None
    interval = arb(0).union(step)
    is_invariant = all(
        (coordinate + interval * rate) in bounds for coordinate, rate, bounds in zip(state, rates_in_enclosure, enclosure, strict=True)
    )
    return enclosure if is_invariant else None


def _step_size(series: Sequence[arb]) -> arb:
    """Return the step at which the term of the highest order is as small as the error allowed."""
    last = max((abs(coefficient).abs_upper() for coefficient in series[-4:]), default=arb(0))
    if not last.is_finite() or last <= _MAX_ERROR:
        return arb(1) / 4
    return (_MAX_ERROR / last) ** (arb(1) / len(series))


def _power_of_2(value: arb) -> arb:
    """Return a power of 2 below the value, at most 1/4."""
    exponent = (value.abs_lower().log() / arb(2).log()).floor().unique_fmpz()
    return arb(2) ** min(int(exponent) if exponent is not None else -20, -2)


def _horner(series: Sequence[arb], step: arb) -> arb:
    value = arb(0)
    for coefficient in reversed(series):
        value = value * step + coefficient
    return value
