"""Points within the rounding of the numbers given at which the rank is lower.

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
import numpy as np
from flint import arb

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.places import Place
from obsdesign.rank.elimination import Rank, rank_of
from obsdesign.rank.numbers import Number, as_ball
from obsdesign.rank.pivoting import Pivots, Rows, Scales, pivots_of, scales_of, schur_complement
from obsdesign.rank.reading import ROUNDINGS, is_exact, is_residue

SMALL = 1e-9
"""Pivots below this, relative to rows and columns scaled to 1, may be of the size of rounding errors of doubles."""
_BITS, _STEP = 768, 256
_VANISHED = 1e-6  # of what was left: Newton's method leaves its square
_FARTHEST = 1.5  # units of rounding: the smallest sum of squares is not the smallest largest step
_ORDERS, _FEW = 40, 8  # derivatives that are taken: 2 n + 12 of them where the states are few
_LEFT_OVER = (1e-20, 1e-12)  # a long number of this size may be what is left of 0 where numbers of size 1e-4 to 1e4 cancel


@dataclass(frozen=True)
class Rounded:
    """A number that may be rounded: entry `index` of the constants or of the state, and how far it may be from what was meant."""

    is_constant: bool
    index: int
    distance: Fraction


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
    at = _Point(Experiments(equations, place, orders, 2 if equations.known else 1, seed))
    with flint.ctx.workprec(_BITS // 4):
        box = _Point(replace(at.experiments, orders=order)).within(numbers)
        keeps_rank = _at_least(box, rank)
        if keeps_rank and (full or not equations.unknown or _keeps_inputs(at.within(numbers))):
            return None
    with flint.ctx.workprec(_BITS):
        box = at.within(numbers)
        lower = None if keeps_rank or _at_least(box, rank) else _lower(at, box, numbers, rank)
        return lower or (None if full or _keeps_inputs(box) else _higher(at, box, numbers, rank))


def _lower(at: _Point, box: _Point, numbers: Sequence[Rounded], rank: int) -> Neighbour | None:
    """Return the rank where a pivot of J vanishes."""
    rows = box.rows_as_balls()
    if not _are_finite(rows):
        return None
    scales = scales_of(rows)
    pivots = pivots_of(scales.of(at.rows()), at.eliminated)
    if sum(j >= at.eliminated for _, (_, j) in pivots) < rank:
        return None
    least = sum(j < at.eliminated or size > SMALL for size, (_, j) in pivots)
    for there, kept, by_constants in _vanishing(at, numbers, pivots, least, scales, at.width):
        remaining = [there[i] for i, _ in kept]
        smaller = rank_of(lambda rows=remaining: rows, at.width - at.eliminated, at.eliminated, confirmed=False, precisions=(_BITS,))
        return Neighbour(smaller, by_constants)
    return None


def _higher(at: _Point, box: _Point, numbers: Sequence[Rounded], rank: int) -> Neighbour | None:
    """Return the rank where a pivot of J_w vanishes, if it is higher there.

    Columns of J_w without a pivot are combinations of those with one where the rest of J_w vanishes: they are left out.
    """
    rows = box.rows_as_balls()
    if not _are_finite(rows):
        return None
    inputs = at.eliminated
    scales = scales_of([row[:inputs] for row in rows])
    pivots = pivots_of(scales.of(_leading(at.rows(), inputs)), inputs)
    least = sum(size > SMALL for size, _ in pivots)
    for there, kept, by_constants in _vanishing(at, numbers, pivots, least, scales, inputs):
        reduced = [[row[j] for _, j in kept] + row[inputs:] for row in there]
        larger = rank_of(lambda rows=reduced: rows, at.width - inputs, len(kept), confirmed=False, precisions=(_BITS,))
        if larger.rank > rank:
            return Neighbour(larger, by_constants)
    return None


def _vanishing(
    at: _Point, numbers: Sequence[Rounded], pivots: Sequence[tuple[float, tuple[int, int]]], least: int, scales: Scales, width: int
) -> Iterator[tuple[Rows, Pivots, bool]]:
    """Yield J at the points within rounding where what some of the pivots leave of its first columns vanishes, these pivots, and whether
    constants differ there; states are moved first."""
    for count in range(least, len(pivots)):
        kept = [pivot for _, pivot in pivots[:count]]
        for chosen in ([number for number in numbers if not number.is_constant], numbers):
            there = _newton(at, chosen, kept, scales, width)
            if there is not None:
                yield there.rows_as_balls(), kept, any(number.is_constant for number in chosen)


@dataclass(frozen=True, eq=False)
class _Point:
    """Experiments whose numbers can be moved."""

    experiments: Experiments

    @property
    def eliminated(self) -> int:
        return self.experiments.eliminated

    @property
    def width(self) -> int:
        return self.experiments.width

    def rows_as_balls(self) -> Rows:
        """Return J."""
        return self.experiments.rows()

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
    """Return whether the rank of what is asked about is at least so much at all of the points, by proof."""
    return _rank_at_least(points.rows_as_balls(), points.eliminated, rank)


def _keeps_inputs(points: _Point) -> bool:
    """Return whether J_w has the same rank at all of the points, by proof."""
    if not points.eliminated:
        return True
    rows = _leading(points.rows_as_balls(), points.eliminated)
    middle = [[entry.mid() for entry in row] for row in rows]
    most = rank_of(lambda: middle, points.eliminated, confirmed=False, precisions=(flint.ctx.prec,)).rank
    return _rank_at_least(rows, 0, most)


def _rank_at_least(rows: Rows, eliminated: int, rank: int) -> bool:
    if not _are_finite(rows):
        return False
    return rank_of(lambda: rows, len(rows[0]) - eliminated, eliminated, confirmed=False, precisions=(flint.ctx.prec,)).rank >= rank


def _are_finite(rows: Rows) -> bool:
    return all(entry.is_finite() for row in rows for entry in row)


def _leading(rows: Rows, width: int) -> Rows:
    return [row[:width] for row in rows]


def _newton(at: _Point, numbers: Sequence[Rounded], pivots: Pivots, scales: Scales, width: int) -> _Point | None:
    """Return the point within rounding at which what is left of the first columns after the pivots vanishes; None where there is none."""
    if not numbers:
        return None
    left = schur_complement(scales.of(_leading(at.rows(), width)), pivots)
    size = max(abs(entry) for entry in left)
    slopes: list[list[float]] = []
    for number in numbers:
        further = schur_complement(scales.of(_leading(at.moved([number], [number.distance / 2**_STEP]).rows(), width)), pivots)
        slopes.append([float((b - a) * 2**_STEP / size) for a, b in zip(left, further, strict=True)])
    wanted = np.array([-float(entry / size) for entry in left])
    steps = np.linalg.lstsq(np.array(slopes).T, wanted, rcond=1e-12)[0]
    if np.abs(steps).max() > _FARTHEST:
        return None
    there = at.moved(numbers, [number.distance * Fraction(float(step)) for number, step in zip(numbers, steps, strict=True)])
    after = max(abs(entry) for entry in schur_complement(scales.of(_leading(there.rows(), width)), pivots))
    return there if after < _VANISHED * size else None
