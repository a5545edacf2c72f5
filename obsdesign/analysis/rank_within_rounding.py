"""Points within the rounding of the numbers given at which the rank is lower.

Let p be the numbers that may be rounded, d_i how far each may be from what was meant. After r pivots of the Jacobian J(p) what is left
is S(p) = J_22 - J_21 J_11^-1 J_12: the rank is r where S = 0. With S(p) small, the smallest t (in units of d) with
S + sum_i (dS/dp_i) d_i t_i = 0 is a step of Newton's method to such a point: if it is within the rounding, and S all but vanishes there,
no more than r is seen within the rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import flint

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import Place
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.modular_points import residue_place
from obsdesign.analysis.vanishing_minors import Eliminated, Point, Rounded, leading, vanishing
from obsdesign.rank.decimal_reading import ROUNDINGS, is_exact, is_residue
from obsdesign.rank.elimination import Rank, rank_of
from obsdesign.rank.pivoting import Rows, holds_rank, pivots_of, scales_of

SMALL = 1e-9
"""Pivots below this, relative to rows and columns scaled to 1, may be of the size of rounding errors of doubles."""
_BITS, _FEWER_BITS = 768, 384
_ORDERS, _FEW = 40, 8  # derivatives that are taken: 2 n + 12 of them where the states are few
_SEARCHED = 3e7  # multiplications, some 5 s: a point whose coordinates alone may be rounded is looked for within these
_LEFT_OVER = (1e-20, 1e-12)  # a long number of this size may be what is left of 0 where numbers of size 1e-4 to 1e4 cancel


@dataclass(frozen=True, eq=False)
class Neighbour:
    """The rank at a point within rounding, and whether constants differ there."""

    rank: Rank
    by_constants: bool


def rounded_constants(equations: Equations) -> list[Rounded]:
    """Return the constants of the model that may have been rounded."""
    return [Rounded(True, equations.values.index(number), _distance(value)) for value, number in equations.read if not is_exact(value)]


def rounded_states(at: Sequence[float]) -> list[Rounded]:
    """Return the entries of a point (n,) that may have been rounded."""
    return [Rounded(False, i, _distance(value)) for i, value in enumerate(at) if not is_exact(value)]


def _distance(value: float) -> Fraction:
    cancelled = is_residue(value) or _LEFT_OVER[0] < abs(value) < _LEFT_OVER[1]
    return Fraction(abs(value)) if cancelled else ROUNDINGS * Fraction(math.ulp(value))


def neighbour_within(equations: Equations, place: Place, numbers: Sequence[Rounded], rank: int, order: int, seed: int) -> Neighbour | None:
    """Return another rank at a point within rounding; None where there is none, or none is found.

    rank, order: the rank at the place, and the order of derivatives at which it was reached. The rank of what is asked about is
    rank J - rank J_w: it is lower where J loses a pivot, and higher where J_w does, so that a row of J is free of unknown inputs.
    """
    full = rank == equations.asked
    orders = min(2 * equations.n + 12 if equations.n <= _FEW else max(order, equations.n) + 1, _ORDERS)
    at = Point(Experiments(equations, place, orders, 2 if equations.known else 1, seed))
    with flint.ctx.workprec(_BITS // 4):
        box = Point(replace(at.experiments, orders=order)).within(numbers)
        keeps_rank = _at_least(box, rank)
        if keeps_rank and (full or _keeps_inputs(at, at.within(numbers))):
            return None
    with flint.ctx.workprec(_BITS):
        box = at.within(numbers)
        searched = any(number.is_constant for number in numbers) or _operations(at, numbers) <= _SEARCHED
        lower = _lower(at, box, numbers, rank, order) if searched and not keeps_rank and not _at_least(box, rank) else None
        return lower or (None if full or _keeps_inputs(at, box) else _higher(at, box, numbers, rank))


def _operations(at: Point, numbers: Sequence[Rounded]) -> int:
    """Return about how many multiplications it takes to know what each of the numbers changes."""
    experiments = at.experiments
    return len(numbers) * experiments.count * experiments.orders**2 * experiments.equations.n**2


def _lower(at: Point, box: Point, numbers: Sequence[Rounded], rank: int, order: int) -> Neighbour | None:
    """Return the rank where a pivot of J vanishes.

    Derivatives of the lowest orders that show the rank are looked at first: where their rank is lower nowhere, that of more is not.
    """
    with flint.ctx.workprec(_FEWER_BITS):
        if not _may_be_lower(at, numbers, rank, order):
            return None
    eliminated = _eliminated(at, box, rank)
    for there, kept, by_constants in vanishing(at, numbers, eliminated, at.width) if eliminated else ():
        remaining = [there[i] for i, _ in kept]
        smaller = rank_of(lambda rows=remaining: rows, at.width - at.eliminated, at.eliminated, confirmed=False, precisions=(_BITS,))
        return Neighbour(smaller, by_constants)
    return None


def _may_be_lower(at: Point, numbers: Sequence[Rounded], rank: int, order: int) -> bool:
    """Return whether a pivot of the fewest rows of J that show the rank vanishes within rounding: more rows only ask for more."""
    while order < at.experiments.orders:
        for count in range(1, at.experiments.count + 1):
            few = Point(replace(at.experiments, orders=order, count=count))
            eliminated = _eliminated(few, few.within(numbers), rank)
            if eliminated:
                return next(vanishing(few, numbers, eliminated, few.width), None) is not None
        order = order + order // 2 + 1
    return True


def _eliminated(at: Point, box: Point, rank: int) -> Eliminated | None:
    """Return the pivots of J; None where these are not as many as the rank asks for, or J has no value."""
    rows = box.rows_as_balls()
    if not _are_finite(rows):
        return None
    scales = scales_of(rows)
    pivots = pivots_of(scales.of(at.rows()), at.eliminated)
    if sum(j >= at.eliminated for _, (_, j) in pivots) < rank:
        return None
    least = sum(j < at.eliminated or size > SMALL for size, (_, j) in pivots)
    return Eliminated(scales, [pivot for _, pivot in pivots], least)


def _higher(at: Point, box: Point, numbers: Sequence[Rounded], rank: int) -> Neighbour | None:
    """Return the rank where a pivot of J_w vanishes, if it is higher there.

    Columns of J_w without a pivot are combinations of those with one where the rest of J_w vanishes: they are left out.
    """
    rows = box.rows_as_balls()
    if not _are_finite(rows):
        return None
    inputs = at.eliminated
    scales = scales_of([row[:inputs] for row in rows])
    pivots = pivots_of(scales.of(leading(at.rows(), inputs)), inputs)
    eliminated = Eliminated(scales, [pivot for _, pivot in pivots], sum(size > SMALL for size, _ in pivots))
    for there, kept, by_constants in vanishing(at, numbers, eliminated, inputs):
        reduced = [[row[j] for _, j in kept] + row[inputs:] for row in there]
        larger = rank_of(lambda rows=reduced: rows, at.width - inputs, len(kept), confirmed=False, precisions=(_BITS,))
        if larger.rank > rank:
            return Neighbour(larger, by_constants)
    return None


def _at_least(points: Point, rank: int) -> bool:
    """Return whether the rank of what is asked about is at least so much at all of the points, by proof."""
    return _rank_at_least(points.rows_as_balls(), points.eliminated, rank)


def _keeps_inputs(at: Point, points: Point) -> bool:
    """Return whether the rank of J_w is nowhere less than at the point, by proof."""
    if not points.eliminated:
        return True
    rows = leading(points.rows_as_balls(), points.eliminated)
    if _are_finite(rows) and holds_rank(rows, _most_inputs(at.experiments)):
        return True
    middle = [[entry.mid() for entry in row] for row in rows]
    most = rank_of(lambda: middle, points.eliminated, confirmed=False, precisions=(flint.ctx.prec,)).rank
    return _rank_at_least(rows, 0, most)


def _most_inputs(experiments: Experiments) -> int:
    """Return what the rank of J_w is at most with these constants (modulo the prime)."""
    try:
        there = residue_place(experiments.equations, experiments.seed)
        return replace(experiments, place=there).bound(experiments.orders).eliminated
    except ZeroDivisionError:  # a pole
        return experiments.eliminated


def _rank_at_least(rows: Rows, eliminated: int, rank: int) -> bool:
    if not _are_finite(rows):
        return False
    if not eliminated and holds_rank(rows, rank):
        return True
    return rank_of(lambda: rows, len(rows[0]) - eliminated, eliminated, confirmed=False, precisions=(flint.ctx.prec,)).rank >= rank


def _are_finite(rows: Rows) -> bool:
    return all(entry.is_finite() for row in rows for entry in row)
