"""What the dimension is at least and at most at all points within the rounding of numbers.

The dimension is rank J - rank J_w, with J = [J_w J_x] and J_w the columns of the unknown inputs.

At most: a column of J_w that is left out lowers rank J by no more than 1. So with columns C of J_w that are independent at all of the
points it is nowhere more than rank [C J_x] - |C|. It does not matter how the others vanish: where C G = 0 within rounding, J_w is block
Toeplitz, and its last pivot a high power of what rounding leaves.

At least: whichever columns make the pivots of J_w, C or some of the others, too, behind them so many pivots of J_x are left as
rounding cannot change to 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import flint
from flint import arb, arb_mat

from obsdesign.analysis.vanishing_minors import MovablePoint, RoundedNumber, changes_along, leading_columns
from obsdesign.rank.elimination import Rank, rank_of
from obsdesign.rank.pivoting import Complement, Pivots, RowColumnScales, Rows, complement_of, largest_proven_minor, scales_of

_CERTAIN = 2  # times what rounding changes to first order: an entry of S that is more vanishes nowhere within rounding


def upper_bound(at: MovablePoint, numbers: Sequence[RoundedNumber]) -> Rank:
    """Return the rank of what is asked about where the numbers are anywhere within their rounding, at most."""
    n_inputs, rows = at.n_eliminated, at.rows_as_balls()
    columns = [j for _, j in _independent_columns(at, numbers).pivots]
    return _rank_beyond([[row[j] for j in columns] + row[n_inputs:] for row in rows], len(columns))


def lower_bound(at: MovablePoint, numbers: Sequence[RoundedNumber], rank: int) -> Rank | None:
    """Return a rank of what is asked about that may be all that is left within rounding; None where no less than `rank` is left."""
    elimination = _independent_columns(at, numbers)
    changes = elimination.changes(at, numbers)
    for pivots in _possible_pivots(elimination, at.n_eliminated):
        with_states = _extend(elimination, changes, pivots, at.n_eliminated)
        if len(with_states) - len(pivots) < rank:
            rows = at.rows_as_balls()
            return _rank_beyond([rows[i] for i, _ in with_states] or [[arb(0)] * at.width], at.n_eliminated)
    return None


@dataclass(frozen=True, eq=False)
class _Elimination:
    """J scaled, with midpoints of its entries, and pivots of J_w that vanish nowhere within rounding."""

    rows: Rows
    scales: RowColumnScales
    pivots: Pivots

    @property
    def complement(self) -> Complement | None:
        """What the pivots leave."""
        return complement_of(self.rows, self.pivots)

    def changes(self, at: MovablePoint, numbers: Sequence[RoundedNumber]) -> list[arb_mat]:
        """Return for every number the change of J, to first order, along what the pivots leave."""
        complement = self.complement
        return list(changes_along(at, numbers, self.scales, complement)) if complement and complement.value else []


def _independent_columns(at: MovablePoint, numbers: Sequence[RoundedNumber]) -> _Elimination:
    """Return pivots of J_w that vanish nowhere within rounding, as many as show.

    Most by proof, in balls; of S, which these leave, an entry joins that is larger than rounding changes it to first order.
    """
    n_inputs = at.n_eliminated
    box = at.within(numbers).rows_as_balls()
    if not all(entry.is_finite() for row in box for entry in row):
        return _Elimination(at.rows(), scales_of(at.rows()), [])
    scales = scales_of(box)
    rows = scales.apply(at.rows())
    inputs = _Elimination(leading_columns(rows, n_inputs), scales.leading(n_inputs), largest_proven_minor(leading_columns(box, n_inputs)))
    return _Elimination(rows, scales, _extend(inputs, inputs.changes(at, numbers), inputs.pivots, 0))


def _extend(elimination: _Elimination, changes: Sequence[arb_mat], pivots: Pivots, first_column: int) -> Pivots:
    """Return the pivots and others behind them, of the columns from the first one on, that vanish nowhere within rounding."""
    first = elimination.complement
    complement = complement_of(elimination.rows, pivots)
    while first and complement and changes and (pivot := _certain_entry(complement, first, changes, first_column)):
        pivots = [*pivots, pivot]
        complement = complement_of(elimination.rows, pivots)
    return pivots


def _certain_entry(complement: Complement, first: Complement, changes: Sequence[arb_mat], first_column: int) -> tuple[int, int] | None:
    """Return row and column of the entry of S that is the most times what rounding changes it, if that is enough."""
    slopes = [complement.slope(change, first) for change in changes]
    ratios = [
        (abs(entry) / (sum((abs(slope[k]) for slope in slopes), arb(0)) + _negligible()), k)
        for k, entry in enumerate(complement.value)
        if abs(entry) > _negligible() and complement.position(k)[1] >= first_column
    ]
    ratio, k = max(ratios, default=(arb(0), 0))
    return complement.position(k) if ratio > _CERTAIN else None


def _possible_pivots(elimination: _Elimination, n_inputs: int) -> Iterator[Pivots]:
    """Yield the pivots of J_w, and with others that may vanish or not: in any row the first, then the largest entries."""
    yield elimination.pivots
    for pivot in _largest_entries(elimination.complement, n_inputs):
        pivots = [*elimination.pivots, pivot]
        yield pivots
        while following := _largest_entries(complement_of(elimination.rows, pivots), n_inputs):
            pivots = [*pivots, following[0]]
            yield pivots


def _largest_entries(complement: Complement | None, width: int) -> list[tuple[int, int]]:
    """Return row and column of the largest entry of S in each row, of the first columns, unless it is negligible, the largest first."""
    largest: dict[int, tuple[arb, tuple[int, int]]] = {}
    for k, entry in enumerate(complement.value) if complement else ():
        row, column = complement.position(k) if complement else (0, 0)
        if column < width and abs(entry) > max(_negligible(), largest.get(row, (arb(0), ()))[0]):
            largest[row] = abs(entry), (row, column)
    return [position for _, position in sorted(largest.values(), reverse=True)]


def _negligible() -> arb:
    """What is left of 0 after elimination, relative to rows and columns scaled to 1, is less than this."""
    return arb(2) ** (-flint.ctx.prec // 2)


def _rank_beyond(rows: Rows, n_eliminated: int) -> Rank:
    return rank_of(lambda: rows, len(rows[0]) - n_eliminated, n_eliminated, confirm=False, precisions=(flint.ctx.prec,))
