"""Ranks in ball arithmetic: at least r because an r x r minor's ball excludes 0. At most r is proven elsewhere: see `RankBound`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import flint
import numpy as np
from flint import arb

from obsdesign.rank.ball_rows import Rows, clear_column, max_exponent, orthonormal_basis, scale_row
from obsdesign.rank.balls import BALLS, CONFIRMING_BITS, PRECISIONS, is_finite
from obsdesign.rank.exact_numbers import Number, as_ball
from obsdesign.rank.graph import Instruction, NoValueError, evaluate, instructions


@dataclass(frozen=True)
class RankBound:
    """What the rank of a matrix (m, eliminated + n) is at most, by proof.

    rank: of what goes beyond the eliminated columns, if these have rank `n_eliminated`, which is the most that they can have;
    is_determined: for each of the n columns whether its unit covector is a combination of rows, if both ranks are reached; None where
    that is not asked. with_start: the same with rows for states that are known at the start, where there are such.
    """

    rank: int
    n_eliminated: int
    is_determined: tuple[bool, ...] | None
    with_start: RankBound | None = None


@dataclass(frozen=True, eq=False)
class Rank:
    """Rank of a matrix (m, n) at a point: at least `rank` by proof; where not `is_decided`, perhaps more.

    bits: precision used; rows, columns: of the pivots, in order; is_determined: for every column whether its unit covector is in the
    row space; is_exact: whether that is so because entries are exactly 0; null_space (n, n - rank): orthonormal basis of what the
    pivots' rows annihilate, a row of it 0 where seen; null_basis (n, n - rank): of the same, each with a state of its own that the others
    leave as it is, entries to double precision relative to themselves;
    smallest_pivot, largest_remainder: what was told from 0 and what was not, relative to rows and columns scaled to 1; with_start: the
    same with rows for states that are known at the start, where there are such and it was counted.
    """

    rank: int
    is_decided: bool
    bits: int
    smallest_pivot: float
    largest_remainder: float
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    is_determined: tuple[bool, ...]
    is_exact: bool
    null_space: np.ndarray
    null_basis: np.ndarray
    with_start: Rank | None = None


def rank_at(
    matrix: ca.Function,
    arguments: Sequence[Sequence[Number]],
    stages: Sequence[int] | None = None,
    n_eliminated: int = 0,
    *,
    confirm: bool = True,
) -> Rank:
    """Return the rank of matrix(arguments) (m, eliminated + n), doubling the precision until it is decided or the limit reached.

    stages: a number per row; pivots come from rows of a lower stage as long as these have any; n_eliminated, confirm: see `rank_of`.
    Raises NoValueError where a row has no finite value at any precision, NotExactError.
    """
    graph = instructions(matrix)
    n = matrix.size2_out(0) - n_eliminated
    return rank_of(lambda: values_at(matrix, arguments, graph), n, n_eliminated, stages, confirm=confirm)


def rank_of(
    rows_at_precision: Callable[[], Rows],
    n: int,
    n_eliminated: int = 0,
    stages: Sequence[int] | None = None,
    *,
    confirm: bool = True,
    precisions: Sequence[int] = PRECISIONS,
    upper_bound: RankBound | None = None,
) -> Rank:
    """Return the rank of rows (m, eliminated + n) that are made anew at each precision, as far as it goes beyond `n_eliminated` columns.

    It is the rank of the combinations of rows in which the first `n_eliminated` columns vanish: of those in the other n columns.
    upper_bound: what it is at most, by proof; it is decided where it is that, and undecided where it comes out as more, or less.
    Without one, what counts as 0 is thin, and (confirmed) must be so at CONFIRMING bits. precisions: bits, tried in turn.
    Raises NoValueError where a row has no finite value at any precision.
    """
    rank, rows_without_value, least_bits = None, [], 0
    for bits in precisions:
        if bits < least_bits:
            continue
        with flint.ctx.workprec(bits):
            rows = rows_at_precision()
            rows_without_value = [i for i, row in enumerate(rows) if not all(is_finite(entry) for entry in row)]
            rank = None if rows_without_value else _rank_beyond(rows, n_eliminated, n, stages, upper_bound)
        if rank is None or not rank.is_decided:
            if rank and upper_bound and rank.rank > upper_bound.rank:
                break
            continue
        if upper_bound or not confirm or bits >= CONFIRMING_BITS or (rank.rank == n and not n_eliminated):
            break
        least_bits = CONFIRMING_BITS
    if rank is None:
        raise NoValueError(rows_without_value[0], f"row {rows_without_value[0]} of the matrix")
    return rank


def values_at(matrix: ca.Function, arguments: Sequence[Sequence[Number]], graph: Sequence[Instruction] | None = None) -> Rows:
    """Return the matrix (m, n) at the working precision; graph: its instructions, where they are at hand."""
    shape = matrix.sparsity_out(0)
    balls = [[as_ball(value) for value in argument] for argument in arguments]
    rows = [[arb(0)] * shape.size2() for _ in range(shape.size1())]
    for entry, i, j in zip(evaluate(graph or instructions(matrix), balls, BALLS), shape.row(), shape.get_col(), strict=True):
        rows[i][j] = entry
    return rows


def first_without_value(matrix: ca.Function, arguments: Sequence[Sequence[Number]]) -> int | None:
    """Return the first row of the matrix that has no finite value at any precision."""
    graph = instructions(matrix)
    rows_without_value: list[int] = []
    for bits in PRECISIONS:
        with flint.ctx.workprec(bits):
            rows = values_at(matrix, arguments, graph)
            rows_without_value = [i for i, row in enumerate(rows) if not all(is_finite(entry) for entry in row)]
        if not rows_without_value:
            return None
    return rows_without_value[0]


def _rank_beyond(rows: Rows, n_eliminated: int, n: int, stages: Sequence[int] | None, upper_bound: RankBound | None) -> Rank:
    stages = stages or [0] * len(rows)
    if not n_eliminated:
        return _eliminate(rows, n, stages, upper_bound)
    # numbers are scaled before the first elimination: rows by their size, so that thin means the same for all
    rows = [scale_row(row, [max_exponent(row)] * len(row)) for row in rows]
    reduced, pivots, _ = _reduce(rows, range(n_eliminated), [0] * len(rows))
    remaining_rows = [i for i in range(len(rows)) if i not in pivots.values()]
    is_full_rank = upper_bound is not None and len(pivots) == upper_bound.n_eliminated  # what is left of these columns is 0, by proof
    usable_rows = [i for i in remaining_rows if is_full_rank or _is_free(reduced[i][:n_eliminated], exactly=upper_bound is not None)]
    rank = _eliminate([reduced[i][n_eliminated:] for i in usable_rows], n, [stages[i] for i in usable_rows], upper_bound)
    # a row that is not told to be free of the eliminated columns tells nothing
    is_decided = rank.is_decided and (usable_rows == remaining_rows or rank.rank == n)
    return replace(rank, is_decided=is_decided, rows=tuple(usable_rows[i] for i in rank.rows))


def _is_free(entries: Sequence[arb], *, exactly: bool) -> bool:
    """Return whether the entries are 0: exactly, or as far as the precision reaches."""
    return all(entry.is_zero() for entry in entries) if exactly else all(entry.abs_upper() <= _zero_threshold() for entry in entries)


def _eliminate(rows: Rows, n: int, stages: Sequence[int], upper_bound: RankBound | None) -> Rank:
    """Gauss-Jordan elimination with full pivoting within each stage, on rows and columns scaled by powers of 2."""
    rows = [scale_row(row, [max_exponent(row)] * n) for row in rows]
    column_exponents = [max_exponent([row[j] for row in rows]) for j in range(n)]
    rows, pivots, smallest = _reduce([scale_row(row, column_exponents) for row in rows], range(n), stages)
    free = [j for j in range(n) if j not in pivots]
    remainders = [rows[i][j].abs_upper() for i in range(len(rows)) if i not in pivots.values() for j in free]
    zero_sizes = [rows[i][j].abs_upper() for i in pivots.values() for j in free if 0 in rows[i][j]]
    is_determined = tuple(j in pivots and all(0 in rows[pivots[j]][k] for k in free) for j in range(n))
    is_proven = upper_bound is None or not free or (len(pivots) == upper_bound.rank and upper_bound.is_determined in (None, is_determined))
    vectors = [_null_vector(rows, pivots, j, column_exponents) for j in free]
    return Rank(
        rank=len(pivots),
        is_decided=is_proven and all(size <= _zero_threshold() for size in (zero_sizes if upper_bound else remainders + zero_sizes)),
        bits=flint.ctx.prec,
        smallest_pivot=smallest,
        largest_remainder=max(map(float, remainders), default=0.0),
        rows=tuple(pivots.values()),
        columns=tuple(pivots),
        is_determined=is_determined,
        is_exact=all(size.is_zero() for size in zero_sizes),
        null_space=orthonormal_basis(vectors, n),
        null_basis=np.array([[float(vector[j]) for vector in vectors] for j in range(n)]).reshape(n, len(vectors)),
    )


def _zero_threshold() -> arb:
    """What is left around 0 counts as 0 where it is thinner than this."""
    return arb(2) ** (-flint.ctx.prec // 2)


def _reduce(rows: Rows, columns: range, stages: Sequence[int]) -> tuple[Rows, dict[int, int], float]:
    """Return the rows with as many of the columns as possible cleared, {column: row} of the pivots, the smallest of them."""
    pivots: dict[int, int] = {}
    smallest = math.inf
    while pivot := _pivot(rows, pivots, columns, stages):
        row, column = pivot
        smallest = min(smallest, float(rows[row][column].abs_lower()))
        rows = clear_column(rows, row, column)
        pivots[column] = row
    return rows, pivots, smallest


def _pivot(rows: Rows, pivots: Mapping[int, int], columns: range, stages: Sequence[int]) -> tuple[int, int] | None:
    """Return row and column of the entry farthest from 0 in the lowest stage with an entry that excludes 0."""
    pivot_rows = set(pivots.values())
    rows_left = [i for i in range(len(rows)) if i not in pivot_rows]
    for stage in sorted({stages[i] for i in rows_left}):
        sizes = [(rows[i][j].abs_lower(), i, j) for i in rows_left if stages[i] == stage for j in columns if j not in pivots]
        size, row, column = max(sizes, default=(arb(0), 0, 0))
        if size > 0:
            return row, column
    return None


def _null_vector(rows: Rows, pivots: Mapping[int, int], free: int, column_exponents: Sequence[int]) -> list[arb]:
    """Return the vector (n,) that the pivots' rows annihilate with its free entry not 0, in units of the unscaled columns."""
    vector = [-rows[pivots[j]][free] if j in pivots else arb(int(j == free)) for j in range(len(column_exponents))]
    scaled_vector = scale_row([arb(0) if 0 in entry else entry for entry in vector], column_exponents)
    return scale_row(scaled_vector, [max_exponent(scaled_vector)] * len(scaled_vector))
