"""Points within the rounding of numbers at which what pivots leave of a Jacobian vanishes: one step of Newton's method."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import flint
import numpy as np
from flint import arb, arb_mat

from obsdesign.analysis.experiments import Experiments
from obsdesign.rank.exact_numbers import Number, as_ball
from obsdesign.rank.pivoting import Complement, Pivots, RowColumnScales, Rows, complement_of

_VANISHED = 1e-6  # of what was left: Newton's method leaves its square
_MAX_STEP = 1.5  # units of rounding: the smallest sum of squares is not the smallest largest step


@dataclass(frozen=True)
class RoundedNumber:
    """A number that may be rounded: entry `index` of the constants or of the state, and how far it may be from what was meant."""

    is_constant: bool
    index: int
    distance: Fraction

    def behind(self, count: int) -> RoundedNumber:
        """Return the same entry of a state behind so many others."""
        return replace(self, index=self.index + count)


@dataclass(frozen=True)
class Elimination:
    """Pivots of some columns of J scaled; those from `n_certain` on may be rounding."""

    scales: RowColumnScales
    pivots: Pivots
    n_certain: int


@dataclass(frozen=True, eq=False)
class MovablePoint:
    """Experiments whose numbers can be moved."""

    experiments: Experiments

    @property
    def n_eliminated(self) -> int:
        """How many columns, those of the unknown inputs, are eliminated first."""
        return self.experiments.n_eliminated

    @property
    def width(self) -> int:
        """How many columns J has."""
        return self.experiments.n_columns

    def rows_as_balls(self) -> Rows:
        """Return J."""
        return self.experiments.rows()

    def rows(self) -> Rows:
        """Return J with the midpoints of its entries."""
        return [[entry.mid() for entry in row] for row in self.experiments.rows()]

    def move(self, numbers: Sequence[RoundedNumber], steps: Sequence[Number]) -> MovablePoint:
        """Return the point with the steps added to the numbers."""
        equations, evaluation_point = self.experiments.equations, self.experiments.point
        values: list[Number] = [*equations.values]
        state: list[Number] = [*evaluation_point.state]
        for number, step in zip(numbers, steps, strict=True):
            entries = values if number.is_constant else state
            entries[number.index] = as_ball(entries[number.index]) + as_ball(step)
        constants = replace(equations, values=tuple(values))
        return MovablePoint(replace(self.experiments, equations=constants, point=replace(evaluation_point, state=tuple(state))))

    def within(self, numbers: Sequence[RoundedNumber]) -> MovablePoint:
        """Return all points within rounding, as balls."""
        return self.move(numbers, [arb(0, as_ball(number.distance)) for number in numbers])


def vanishing_points(
    at: MovablePoint, numbers: Sequence[RoundedNumber], elimination: Elimination, width: int
) -> Iterator[tuple[Rows, Pivots]]:
    """Yield J at the points within rounding where what some of the pivots leave of its first columns vanishes, and these pivots."""
    scales, pivots = elimination.scales, elimination.pivots
    J = scales.apply(leading_columns(at.rows(), width))
    first = complement_of(J, pivots[: elimination.n_certain]) if elimination.n_certain < len(pivots) else None
    if first is None:
        return
    changes = list(changes_along(at, numbers, scales, first))
    for count in range(elimination.n_certain, len(pivots)):
        complement = complement_of(J, pivots[:count])
        steps = _steps(complement, first, changes) if complement else None
        if complement and steps:
            neighbour = at.move(numbers, [number.distance * Fraction(step) for number, step in zip(numbers, steps, strict=True)])
            after = complement_of(scales.apply(leading_columns(neighbour.rows(), width)), pivots[:count])
            if after and after.size < _VANISHED * complement.size:
                yield neighbour.rows_as_balls(), pivots[:count]


def changes_along(at: MovablePoint, numbers: Sequence[RoundedNumber], scales: RowColumnScales, complement: Complement) -> Iterator[arb_mat]:
    """Yield for every number the change dJ right, to first order, as it is off by its distance; J scaled."""
    directions = scales.of_directions(complement.right.tolist())
    beyond = [[arb(0)] * complement.right.ncols() for _ in range(at.width - len(directions))]
    along = arb_mat([*directions, *beyond])
    before, fineness = at.experiments.along(along), flint.ctx.prec // 3
    for number in numbers:
        after = at.move([number], [number.distance / 2**fineness]).experiments.along(along)
        yield arb_mat(scales.of_rows(((after - before) * arb(2) ** fineness).mid().tolist()))


def _steps(complement: Complement, first: Complement, changes: Sequence[arb_mat]) -> list[float] | None:
    """Return the step, in units of rounding, at which S vanishes to first order; None where it is farther than rounding goes.

    changes: dJ right of the first complement.
    """
    if not complement.size > 0:
        return None
    slopes = [[float(entry / complement.size) for entry in complement.slope(change, first)] for change in changes]
    wanted = np.array([-float(entry / complement.size) for entry in complement.value])
    steps = np.linalg.lstsq(np.array(slopes).T, wanted, rcond=1e-12)[0]
    return [float(step) for step in steps] if np.abs(steps).max() <= _MAX_STEP else None


def leading_columns(rows: Rows, width: int) -> Rows:
    """Return the first `width` columns of rows."""
    return [row[:width] for row in rows]
