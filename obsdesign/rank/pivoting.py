"""Elimination with full pivoting of matrices of numbers (midpoints of balls), the Schur complement that given pivots leave, minors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from flint import arb, arb_mat

Rows = list[list[arb]]
Pivots = list[tuple[int, int]]

_ZERO_PIVOT = 1e-40  # of rows scaled to 1: about half of the 77 digits that the least precision, 256 bits, has; less is no pivot


@dataclass(frozen=True)
class RowColumnScales:
    """Powers of 2 by which rows and columns are divided."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]

    def leading(self, width: int) -> RowColumnScales:
        """Return the scales of the first columns."""
        return RowColumnScales(self.rows, self.columns[:width])

    def apply(self, rows: Rows) -> Rows:
        """Return the rows scaled."""
        exponents = zip(rows, self.rows, strict=True)
        return [_scale_row(row, [column_exponent + exponent for column_exponent in self.columns]) for row, exponent in exponents]

    def of_rows(self, rows: Rows) -> Rows:
        """Return rows of combinations of columns, divided as the rows are."""
        return [_scale_row(row, [exponent] * len(row)) for row, exponent in zip(rows, self.rows, strict=True)]

    def of_directions(self, directions: Rows) -> Rows:
        """Return what multiplies columns as they are, from what multiplies scaled ones."""
        return [_scale_row(row, [width] * len(row)) for row, width in zip(directions, self.columns, strict=True)]


def scales_of(rows_as_balls: Rows) -> RowColumnScales:
    """Return what makes the largest entry of each row and column 1; an entry that is all rounding counts as no more than 1e-12."""
    rows = [[max(abs(entry.mid()), entry.rad() * 2**40) for entry in row] for row in rows_as_balls]
    row_exponents = [_exponent(row) for row in rows]
    column_exponents = [
        _exponent([_scale_row([row[j]], [row_exponent])[0] for row, row_exponent in zip(rows, row_exponents, strict=True)])
        for j in range(len(rows[0]))
    ]
    return RowColumnScales(tuple(row_exponents), tuple(column_exponents))


def pivots_of(rows: Rows, n_first: int) -> list[tuple[float, tuple[int, int]]]:
    """Return size, row and column of the pivots of full pivoting, those of the first columns first."""
    pivots: list[tuple[float, tuple[int, int]]] = []
    for columns in (range(n_first), range(n_first, len(rows[0]))):
        while True:
            used_rows, used_columns = {i for _, (i, _) in pivots}, {j for _, (_, j) in pivots}
            candidates = [(abs(rows[i][j]), i, j) for i in range(len(rows)) if i not in used_rows for j in columns if j not in used_columns]
            size, i, j = max(candidates, default=(arb(0), 0, 0))
            if not candidates or size < _ZERO_PIVOT:
                break
            rows = _clear_column(rows, i, j, used_rows)
            pivots.append((float(size), (i, j)))
    return pivots


@dataclass(frozen=True, eq=False)
class Complement:
    """The Schur complement S = J_22 - J_21 J_11^-1 J_12 that pivots leave of J, and its slopes dS = left dJ right.

    left = [-J_21 J_11^-1, 1], right = [-J_11^-1 J_12; 1], in the order of J's rows and columns; below, rest: the rows and the columns
    without a pivot.
    """

    left: arb_mat
    right: arb_mat
    below: list[int]
    rest: list[int]
    value: list[arb]

    @property
    def size(self) -> arb:
        """Largest entry of S."""
        return max((abs(entry) for entry in self.value), default=arb(0))

    def position(self, k: int) -> tuple[int, int]:
        """Return row and column of J of entry k of S."""
        i, j = divmod(k, len(self.rest))
        return self.below[i], self.rest[j]

    def slope(self, change: arb_mat, fewer: Complement) -> list[arb]:
        """Return dS row by row, from dJ right of the complement of the first of these pivots."""
        share = [[self.right[j, k] for k in range(self.right.ncols())] for j in fewer.rest]
        return _middle(self.left * (change * arb_mat(share)))


def complement_of(rows: Rows, pivots: Pivots) -> Complement | None:
    """Return what the pivots leave of the other rows and columns of J; None where J_11 is not told to be invertible."""
    m, n = len(rows), len(rows[0])
    above, across = [i for i, _ in pivots], [j for _, j in pivots]
    below, rest = ([k for k in range(size) if k not in taken] for size, taken in ((m, set(above)), (n, set(across))))
    left, right = _unit(below, m), _unit(rest, n).transpose()
    try:
        if pivots:
            J_11 = arb_mat([[rows[i][j] for j in across] for i in above])
            left = left - _spread(J_11.transpose().solve(_part(rows, below, across).transpose()).transpose(), above, m)
            right = right - _spread(J_11.solve(_part(rows, above, rest)).transpose(), across, n).transpose()
    except ZeroDivisionError:
        return None
    value = _middle(left * (arb_mat(rows) * right))
    return Complement(left.mid(), right.mid(), below, rest, value)


def _part(rows: Rows, chosen: Sequence[int], columns: Sequence[int]) -> arb_mat:
    return arb_mat(len(chosen), len(columns), [rows[i][j] for i in chosen for j in columns])


def _unit(positions: Sequence[int], width: int) -> arb_mat:
    """Return the matrix (k, width) whose row i is the unit covector of position i."""
    return arb_mat(len(positions), width, [int(j == position) for position in positions for j in range(width)])


def _spread(matrix: arb_mat, columns: Sequence[int], width: int) -> arb_mat:
    """Return the matrix (k, r) with its columns at the given places of `width`."""
    return matrix * _unit(columns, width)


def _middle(matrix: arb_mat) -> list[arb]:
    return [entry.mid() for entry in matrix.entries()]


def holds_rank(rows: Rows, rank: int) -> bool:
    """Return whether every matrix in the balls (m, n) has at least this rank, by proof, if that shows in doubles."""
    return proven_minor(rows, rank) is not None


def proven_minor(rows: Rows, rank: int) -> Pivots | None:
    """Return rows and columns of a minor of this size that vanishes nowhere in the balls (m, n); None where doubles do not show one.

    A minor A is chosen by QR decompositions with pivoting; with R near the inverse of its midpoint, R A = 1 + E is invertible where the
    rows of |E| sum to less than 1.
    """
    if not rank:
        return []
    if rank > min(len(rows), len(rows[0])):
        return None
    values = np.array([[float(entry.mid()) for entry in row] for row in scales_of(rows).apply(rows)])
    if not np.isfinite(values).all():
        return None
    columns = _leading_columns(values, rank)
    chosen = _leading_columns(values[:, columns].T, rank)
    A = _part(rows, chosen, columns)
    try:
        E = A.mid().inv().mid() * A
    except ZeroDivisionError:
        return None
    is_proven = all(sum((abs(E[i, j] - int(i == j)) for j in range(rank)), arb(0)) < 1 for i in range(rank))
    return list(zip(chosen, columns, strict=True)) if is_proven else None


def largest_proven_minor(rows: Rows) -> Pivots:
    """Return rows and columns of a minor that vanishes nowhere in the balls (m, n), as large as doubles show one, by bisection."""
    pivots: Pivots = []
    too_large = min(len(rows), len(rows[0])) + 1
    while len(pivots) + 1 < too_large:
        size = (len(pivots) + too_large) // 2
        minor = proven_minor(rows, size)
        pivots, too_large = (minor, too_large) if minor is not None else (pivots, size)
    return pivots


def _leading_columns(values: np.ndarray, count: int) -> list[int]:
    from scipy.linalg import qr

    return [int(j) for j in qr(values, mode="r", pivoting=True)[-1][:count]]


def _clear_column(rows: Rows, i: int, j: int, used_rows: set[int]) -> Rows:
    """Return the rows with the column of the pivot cleared in the rows that have none."""
    pivot = rows[i]
    result = []
    for k, row in enumerate(rows):
        factor = row[j] / pivot[j]
        is_unchanged = k == i or k in used_rows or not factor
        result.append(
            row if is_unchanged else [(entry - factor * pivot_entry).mid() for entry, pivot_entry in zip(row, pivot, strict=True)]
        )
    return result


def _exponent(entries: Sequence[arb]) -> int:
    mantissa, exponent = max((abs(entry) for entry in entries), default=arb(0)).man_exp()
    return int(exponent) + int(mantissa).bit_length()


def _scale_row(row: Sequence[arb], exponents: Sequence[int]) -> list[arb]:
    return [entry * arb((1, -exponent)) for entry, exponent in zip(row, exponents, strict=True)]
