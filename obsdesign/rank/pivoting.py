"""Elimination with full pivoting of matrices of numbers (midpoints of balls), and the Schur complement that given pivots leave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flint import arb

Rows = list[list[arb]]
Pivots = list[tuple[int, int]]

_NOTHING = 1e-40


@dataclass(frozen=True)
class Scales:
    """Powers of 2 by which rows and columns are divided."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]

    def of(self, rows: Rows) -> Rows:
        """Return the rows scaled."""
        exponents = zip(rows, self.rows, strict=True)
        return [_halved(row, [width + exponent for width in self.columns]) for row, exponent in exponents]


def scales_of(within: Rows) -> Scales:
    """Return what makes the largest entry of each row and column 1; an entry that is all rounding counts as no more than 1e-12."""
    rows = [[max(abs(entry.mid()), entry.rad() * 2**40) for entry in row] for row in within]
    heights = [_exponent(row) for row in rows]
    widths = [_exponent([_halved([row[j]], [height])[0] for row, height in zip(rows, heights, strict=True)]) for j in range(len(rows[0]))]
    return Scales(tuple(heights), tuple(widths))


def pivots_of(rows: Rows, first: int) -> list[tuple[float, tuple[int, int]]]:
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


def schur_complement(rows: Rows, pivots: Pivots) -> list[arb]:
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
