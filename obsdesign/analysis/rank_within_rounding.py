"""Points within the rounding of the numbers given at which the rank is another.

Constants may have been rounded before they were read: where bounds do not exclude another rank within the rounding, nothing is decided
(`dimension_bounds`). A point is taken as it was typed; that the rank is another where its own numbers differ is shown, and said.

Let p be the numbers that may be rounded, d_i how far each may be from what was meant. After r pivots of the Jacobian J(p) what is left
is S(p) = J_22 - J_21 J_11^-1 J_12: the rank is r where S = 0. With S(p) small, the smallest t (in units of d) with
S + sum_i (dS/dp_i) d_i t_i = 0 is a step of Newton's method to such a point: if it is within the rounding, and S all but vanishes there,
no more than r is seen within the rounding.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import flint

from obsdesign.analysis.dimension_bounds import lower_bound, upper_bound
from obsdesign.analysis.equations import Equations
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.modular_points import modular_point
from obsdesign.analysis.vanishing_minors import Elimination, MovablePoint, RoundedNumber, leading_columns, vanishing_points
from obsdesign.rank.decimal_reading import MAX_ULPS, is_exact, is_residue
from obsdesign.rank.elimination import Rank, rank_of
from obsdesign.rank.pivoting import Rows, holds_rank, pivots_of, scales_of

SMALL_PIVOT = 1e-9
"""Pivots below this, relative to rows and columns scaled to 1, may be of the size of rounding errors of doubles."""
_BITS, _FEWER_BITS = 768, 384
_MAX_ORDER, _FEW_STATES = 40, 8  # derivatives that are taken: 2 n + 12 of them where the states are few
_SEARCHED = 3e7  # multiplications, some 5 s: a point whose coordinates alone may be rounded is looked for within these
_CANCELLATION_RANGE = (1e-20, 1e-12)  # a long number of this size may be what is left of 0 where numbers of size 1e-4 to 1e4 cancel


@dataclass(frozen=True, eq=False)
class RoundingNeighbour:
    """The rank at a point within rounding, and whether constants differ there."""

    rank: Rank
    moves_constants: bool


def constants_within_rounding(equations: Equations) -> list[RoundedNumber]:
    """Return the constants of the model that may have been rounded."""
    return [
        RoundedNumber(True, equations.values.index(number), _rounding_distance(value))
        for value, number in equations.readings
        if not is_exact(value) and number in equations.values  # no symbol stands for what is read as 0 or 1
    ]


def states_within_rounding(at: Sequence[float]) -> list[RoundedNumber]:
    """Return the entries of a point (n,) that may have been rounded."""
    return [RoundedNumber(False, i, _rounding_distance(value)) for i, value in enumerate(at) if not is_exact(value)]


def _rounding_distance(value: float) -> Fraction:
    is_cancellation = is_residue(value) or _CANCELLATION_RANGE[0] < abs(value) < _CANCELLATION_RANGE[1]
    return Fraction(abs(value)) if is_cancellation else MAX_ULPS * Fraction(math.ulp(value))


def neighbour_within_rounding(experiments: Experiments, numbers: Sequence[RoundedNumber], rank: int) -> RoundingNeighbour | None:
    """Return another rank at a point within rounding; None where there is none, or none is found.

    experiments: at the place, with derivatives up to the order at which the rank was reached. The rank of what is asked about is
    rank J - rank J_w: it is lower where J loses a pivot, and higher where J_w does, so that a row of J is free of unknown inputs.
    """
    n, order, is_full = experiments.equations.n, experiments.orders, rank == experiments.equations.n_queried
    orders = min(2 * n + 12 if n <= _FEW_STATES else max(order, n) + 1, _MAX_ORDER)
    nominal = MovablePoint(replace(experiments, orders=orders, count=_sufficient_count(experiments)))
    with flint.ctx.workprec(_BITS // 4):
        enclosure = MovablePoint(experiments).within(numbers)
        keeps_rank = _has_rank_at_least(enclosure, rank)
        if keeps_rank and (is_full or _keeps_input_rank(nominal, nominal.within(numbers))):
            return None
    states, constants = ([number for number in numbers if number.is_constant is kind] for kind in (False, True))
    fewer_orders = min(max(order, n) + 1 if nominal.experiments.count == 1 else 2 * n + 2, orders)
    few = MovablePoint(replace(nominal.experiments, orders=fewer_orders))  # beyond these no space grows, and digits are lost
    with flint.ctx.workprec(_BITS):
        lower = higher = None
        if not keeps_rank:
            lower = _neighbour_of_lower_rank(nominal, states, rank, order) or _neighbour_below(few, constants, rank, order)
        if not is_full:
            higher = _neighbour_of_higher_rank(nominal, states, rank) or _neighbour_above(few, constants, rank)
        return lower if lower and lower.moves_constants else higher or lower


def _sufficient_count(experiments: Experiments) -> int:
    """Return how many experiments it takes until more of them tell nothing more: 1 for one signal."""
    if experiments.count == 1:
        return 1
    try:
        orders, residues = (
            max(experiments.orders, experiments.equations.n) + 1,
            modular_point(experiments.equations, experiments.point.state),
        )
        return replace(experiments, point=residues, orders=orders).complete().count
    except ZeroDivisionError:  # a pole
        return experiments.count


def _operations(at: MovablePoint, numbers: Sequence[RoundedNumber]) -> int:
    """Return about how many multiplications it takes to know what each of the numbers changes."""
    experiments = at.experiments
    return len(numbers) * experiments.count * experiments.orders**2 * experiments.equations.n**2


def _neighbour_of_lower_rank(nominal: MovablePoint, states: Sequence[RoundedNumber], rank: int, order: int) -> RoundingNeighbour | None:
    """Return the rank where a pivot of J vanishes and the states alone differ.

    Derivatives of the lowest orders that show the rank are looked at first: where their rank is lower nowhere, that of more is not.
    """
    if not states or _operations(nominal, states) > _SEARCHED:
        return None
    enclosure = nominal.within(states)
    if _has_rank_at_least(enclosure, rank):
        return None
    with flint.ctx.workprec(_FEWER_BITS):
        if not _may_be_lower(nominal, states, rank, order):
            return None
    elimination = _eliminate(nominal, enclosure, rank)
    for perturbed, pivot_positions in vanishing_points(nominal, states, elimination, nominal.width) if elimination else ():
        remaining = [perturbed[i] for i, _ in pivot_positions]
        return RoundingNeighbour(_rank_beyond(remaining, nominal.n_eliminated), False)
    return None


def _may_be_lower(at: MovablePoint, numbers: Sequence[RoundedNumber], rank: int, order: int) -> bool:
    """Return whether a pivot of the fewest rows of J that show the rank vanishes within rounding: more rows only ask for more."""
    for few in _with_more_rows(at, order):
        elimination = _eliminate(few, few.within(numbers), rank) if few is not at else None
        if elimination:
            return next(vanishing_points(few, numbers, elimination, few.width), None) is not None
    return True


def _eliminate(at: MovablePoint, box: MovablePoint, rank: int) -> Elimination | None:
    """Return the pivots of J; None where these are not as many as the rank asks for, or J has no value."""
    rows = box.rows_as_balls()
    if not _are_finite(rows):
        return None
    scales = scales_of(rows)
    pivots = pivots_of(scales.apply(at.rows()), at.n_eliminated)
    if sum(j >= at.n_eliminated for _, (_, j) in pivots) < rank:
        return None
    n_certain = sum(j < at.n_eliminated or size > SMALL_PIVOT for size, (_, j) in pivots)
    return Elimination(scales, [pivot for _, pivot in pivots], n_certain)


def _neighbour_of_higher_rank(nominal: MovablePoint, states: Sequence[RoundedNumber], rank: int) -> RoundingNeighbour | None:
    """Return the rank where a pivot of J_w vanishes and the states alone differ, if it is higher there.

    Columns of J_w without a pivot are combinations of those with one where the rest of J_w vanishes: they are left out.
    """
    enclosure = nominal.within(states)
    rows, n_inputs = enclosure.rows_as_balls(), nominal.n_eliminated
    if not states or not _are_finite(rows) or _keeps_input_rank(nominal, enclosure):
        return None
    scales = scales_of([row[:n_inputs] for row in rows])
    pivots = pivots_of(scales.apply(leading_columns(nominal.rows(), n_inputs)), n_inputs)
    elimination = Elimination(scales, [pivot for _, pivot in pivots], sum(size > SMALL_PIVOT for size, _ in pivots))
    for perturbed, pivot_positions in vanishing_points(nominal, states, elimination, n_inputs):
        higher_rank = _rank_beyond([[row[j] for _, j in pivot_positions] + row[n_inputs:] for row in perturbed], len(pivot_positions))
        if higher_rank.rank > rank:
            return RoundingNeighbour(higher_rank, False)
    return None


def _rank_beyond(rows: Rows, n_eliminated: int) -> Rank:
    return rank_of(lambda: rows, len(rows[0]) - n_eliminated, n_eliminated, confirm=False, precisions=(_BITS,))


def _neighbour_below(nominal: MovablePoint, constants: Sequence[RoundedNumber], rank: int, order: int) -> RoundingNeighbour | None:
    """Return a lower rank where the constants differ, if it may be lower; derivatives of the lowest orders are looked at first."""
    bound = None
    for at in _with_more_rows(nominal, order) if constants else ():
        if _holds(at.within(constants).rows_as_balls(), rank + _max_input_rank(at.experiments)):
            return None
        bound = lower_bound(at, constants, rank)
        if bound is None:
            return None
    return RoundingNeighbour(bound, True) if bound else None


def _neighbour_above(nominal: MovablePoint, constants: Sequence[RoundedNumber], rank: int) -> RoundingNeighbour | None:
    """Return a higher rank where the constants differ, if it may be higher."""
    if not constants or _keeps_input_rank(nominal, nominal.within(constants)):
        return None
    bound = upper_bound(nominal, constants)
    return RoundingNeighbour(bound, True) if bound.rank > rank else None


def _with_more_rows(at: MovablePoint, order: int) -> Iterator[MovablePoint]:
    """Yield the place with derivatives up to the order, then up to higher ones, and with more experiments each time."""
    while order < at.experiments.orders:
        for count in range(1, at.experiments.count + 1):
            yield MovablePoint(replace(at.experiments, orders=order, count=count))
        order = order + order // 2 + 1
    yield at


def _has_rank_at_least(points: MovablePoint, rank: int) -> bool:
    """Return whether the rank of what is asked about is at least so much at all of the points, by proof."""
    return _rank_at_least(points.rows_as_balls(), points.n_eliminated, rank)


def _keeps_input_rank(at: MovablePoint, points: MovablePoint) -> bool:
    """Return whether the rank of J_w is nowhere less than it is at most at the place, by proof."""
    if not points.n_eliminated:
        return True
    return _rank_at_least(leading_columns(points.rows_as_balls(), points.n_eliminated), 0, _max_input_rank(at.experiments))


def _max_input_rank(experiments: Experiments) -> int:
    """Return what the rank of J_w is at most at the place (modulo the prime)."""
    try:
        residues = replace(experiments, point=modular_point(experiments.equations, experiments.point.state))
        return residues.bound(experiments.orders).n_eliminated
    except ZeroDivisionError:  # a pole
        return experiments.n_eliminated


def _rank_at_least(rows: Rows, n_eliminated: int, rank: int) -> bool:
    if not _are_finite(rows):
        return False
    if not n_eliminated and holds_rank(rows, rank):
        return True
    return rank_of(lambda: rows, len(rows[0]) - n_eliminated, n_eliminated, confirm=False, precisions=(flint.ctx.prec,)).rank >= rank


def _holds(rows: Rows, rank: int) -> bool:
    return _are_finite(rows) and holds_rank(rows, rank)


def _are_finite(rows: Rows) -> bool:
    return all(entry.is_finite() for row in rows for entry in row)
