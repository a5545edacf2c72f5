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
import numpy as np
from flint import arb

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.places import Place
from obsdesign.rank.elimination import Rank, rank_of
from obsdesign.rank.numbers import Number, as_ball
from obsdesign.rank.reading import ROUNDINGS, is_exact, is_residue

SMALL = 1e-9
"""Pivots below this, relative to rows and columns scaled to 1, may be of the size of rounding errors of doubles."""
_BITS, _STEP, _NOTHING = 768, 256, 1e-40
_VANISHED = 1e-6  # of what was left: Newton's method leaves its square
_FARTHEST = 1.5  # units of rounding: the smallest sum of squares is not the smallest largest step
_ORDERS, _FEW = 40, 8  # derivatives that are taken: 2 n + 12 of them where the states are few
_LEFT_OVER = (1e-20, 1e-12)  # a long number of this size may be what is left of 0 where numbers of size 1e-4 to 1e4 cancel

Rows = list[list[arb]]
Pivots = list[tuple[int, int]]


@dataclass(frozen=True)
class Rounded:
    """A number that may be rounded: entry `index` of the constants or of the state, and how far it may be from what was meant."""

    is_constant: bool
    index: int
    distance: Fraction


@dataclass(frozen=True, eq=False)
class Lower:
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


def lower_within(equations: Equations, place: Place, numbers: Sequence[Rounded], found: int, order: int, seed: int) -> Lower | None:
    """Return the rank at a point within rounding where it is lower than was found; None where there is none, or none is found.

    found, order: the rank at the place, and the order of derivatives at which it was reached.
    """
    count, n = 2 if equations.known else 1, equations.asked
    with flint.ctx.workprec(_BITS // 4):
        if _at_least(_Point(Experiments(equations, place, order, count, seed)).within(numbers), found):
            return None
    with flint.ctx.workprec(_BITS):
        orders = min(2 * equations.n + 12 if equations.n <= _FEW else max(order, equations.n) + 1, _ORDERS)
        at = _Point(Experiments(equations, place, orders, count, seed))
        if _at_least(at.within(numbers), found):
            return None
        within = at.within(numbers).experiments.rows()
        if not all(entry.is_finite() for row in within for entry in row):
            return None
        scales = _scales(within)
        pivots = _eliminated(scales.of(at.rows()), at.eliminated)
        if sum(j >= at.eliminated for _, (_, j) in pivots) < found:
            return None
        least = sum(j < at.eliminated or size > SMALL for size, (_, j) in pivots)
        for kept in range(least, len(pivots)):
            for chosen in ([each for each in numbers if not each.is_constant], numbers):
                there = _newton(at, chosen, [pivot for _, pivot in pivots[:kept]], scales)
                if there is not None:
                    every = there.experiments.rows()
                    rows = [every[i] for _, (i, _) in pivots[:kept]]
                    rank = rank_of(lambda rows=rows: rows, n, at.eliminated, confirmed=False, precisions=(_BITS,))
                    return Lower(rank, any(each.is_constant for each in chosen))
    return None


@dataclass(frozen=True, eq=False)
class _Point:
    """Experiments whose numbers can be moved."""

    experiments: Experiments

    @property
    def eliminated(self) -> int:
        return self.experiments.eliminated

    def rows(self) -> Rows:
        """Return J with the midpoints of its entries."""
        return [[entry.mid() for entry in row] for row in self.experiments.rows()]

    def moved(self, numbers: Sequence[Rounded], steps: Sequence[Number]) -> _Point:
        """Return the point with the steps added to the numbers."""
        equations, place = self.experiments.equations, self.experiments.place
        values: list[Number] = [*equations.values]
        state: list[Number] = [*place.state]
        for number, step in zip(numbers, steps, strict=True):
            entries = values if number.is_constant else state
            entries[number.index] = as_ball(entries[number.index]) + as_ball(step)
        constants = replace(equations, values=tuple(values))
        return _Point(replace(self.experiments, equations=constants, place=replace(place, state=tuple(state))))

    def within(self, numbers: Sequence[Rounded]) -> _Point:
        """Return all points within rounding, as balls."""
        return self.moved(numbers, [arb(0, as_ball(number.distance)) for number in numbers])


def _at_least(points: _Point, rank: int) -> bool:
    """Return whether the rank is at least so much at all of the points, by proof."""
    rows = points.experiments.rows()
    if not all(entry.is_finite() for row in rows for entry in row):
        return False
    eliminated = points.eliminated
    return rank_of(lambda: rows, len(rows[0]) - eliminated, eliminated, confirmed=False, precisions=(flint.ctx.prec,)).rank >= rank


@dataclass(frozen=True)
class _Scales:
    """Powers of 2 by which rows and columns are divided."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]

    def of(self, rows: Rows) -> Rows:
        """Return the rows scaled."""
        exponents = zip(rows, self.rows, strict=True)
        return [_halved(row, [width + exponent for width in self.columns]) for row, exponent in exponents]


def _scales(within: Rows) -> _Scales:
    """Return what makes the largest entry of each row and column 1; an entry that is all rounding counts as no more than 1e-12."""
    rows = [[max(abs(entry.mid()), entry.rad() * 2**40) for entry in row] for row in within]
    heights = [_exponent(row) for row in rows]
    widths = [_exponent([_halved([row[j]], [height])[0] for row, height in zip(rows, heights, strict=True)]) for j in range(len(rows[0]))]
    return _Scales(tuple(heights), tuple(widths))


def _newton(at: _Point, numbers: Sequence[Rounded], pivots: Pivots, scales: _Scales) -> _Point | None:
    """Return the point within rounding at which what is left after the pivots vanishes; None where there is none."""
    if not numbers:
        return None
    left = _left(scales.of(at.rows()), pivots)
    size = max(abs(entry) for entry in left)
    slopes: list[list[float]] = []
    for number in numbers:
        further = _left(scales.of(at.moved([number], [number.distance / 2**_STEP]).rows()), pivots)
        slopes.append([float((b - a) * 2**_STEP / size) for a, b in zip(left, further, strict=True)])
    wanted = np.array([-float(entry / size) for entry in left])
    steps = np.linalg.lstsq(np.array(slopes).T, wanted, rcond=1e-12)[0]
    if np.abs(steps).max() > _FARTHEST:
        return None
    there = at.moved(numbers, [number.distance * Fraction(float(step)) for number, step in zip(numbers, steps, strict=True)])
    after = max(abs(entry) for entry in _left(scales.of(there.rows()), pivots))
    return there if after < _VANISHED * size else None


def _eliminated(rows: Rows, first: int) -> list[tuple[float, tuple[int, int]]]:
    """Return size, row and column of the pivots of full pivoting, those of the first columns first."""
    pivots: list[tuple[float, tuple[int, int]]] = []
    for columns in (range(first), range(first, len(rows[0]))):
        while True:
            used, taken = {i for _, (i, _) in pivots}, {j for _, (_, j) in pivots}
            free = [(abs(rows[i][j]), i, j) for i in range(len(rows)) if i not in used for j in columns if j not in taken]
            size, i, j = max(free, default=(arb(0), 0, 0))
            if not free or size < _NOTHING:
                break
            rows = _cleared(rows, i, j, used)
            pivots.append((float(size), (i, j)))
    return pivots


def _left(rows: Rows, pivots: Pivots) -> list[arb]:
    """Return what the pivots leave of the other rows and columns."""
    used: set[int] = set()
    for i, j in pivots:
        rows = _cleared(rows, i, j, used)
        used.add(i)
    columns = {j for _, j in pivots}
    return [entry for i, row in enumerate(rows) if i not in used for j, entry in enumerate(row) if j not in columns]


def _cleared(rows: Rows, i: int, j: int, used: set[int]) -> Rows:
    """Return the rows with the column of the pivot cleared in the rows that have none."""
    pivot = rows[i]
    cleared = []
    for k, row in enumerate(rows):
        factor = row[j] / pivot[j]
        skip = k == i or k in used or not factor
        cleared.append(row if skip else [(entry - factor * other).mid() for entry, other in zip(row, pivot, strict=True)])
    return cleared


def _exponent(entries: Sequence[arb]) -> int:
    mantissa, exponent = max((abs(entry) for entry in entries), default=arb(0)).man_exp()
    return int(exponent) + int(mantissa).bit_length()


def _halved(row: Sequence[arb], exponents: Sequence[int]) -> list[arb]:
    return [entry * arb((1, -exponent)) for entry, exponent in zip(row, exponents, strict=True)]
