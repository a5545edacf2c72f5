"""Ranks in ball arithmetic: at least r because an r x r minor's ball excludes 0. At most r is proven elsewhere: see `Bound`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import flint
import numpy as np
from flint import arb

from obsdesign.rank.ball_rows import Rows, cleared, exponent, orthonormal, scaled
from obsdesign.rank.balls import BALLS, CONFIRMING, PRECISIONS, is_finite
from obsdesign.rank.exact_numbers import Number, as_ball
from obsdesign.rank.graph import Instruction, NoValueError, evaluate, instructions


@dataclass(frozen=True)
class Bound:
    """What the rank of a matrix (m, eliminated + n) is at most, by proof.

    rank: of what goes beyond the eliminated columns, if these have rank `eliminated`, which is the most that they can have;
    seen: for each of the n columns whether its unit covector is a combination of rows, if both ranks are reached; None where
    that is not asked.
    """

    rank: int
    eliminated: int
    seen: tuple[bool, ...] | None


@dataclass(frozen=True, eq=False)
class Rank:
    """Rank of a matrix (m, n) at a point: at least `rank` by proof; where not `decided`, perhaps more.

    bits: precision used; rows, columns: of the pivots, in order; seen: for every column whether its unit covector is in the
    row space; exact: whether that is so because entries are exactly 0; null_space (n, n - rank): orthonormal basis of what the
    pivots' rows annihilate, a row of it 0 where seen; null_basis (n, n - rank): of the same, each with a state of its own that the others
    leave as it is, entries to double precision relative to themselves;
    smallest_pivot, largest_remainder: what was told from 0 and what was not, relative to rows and columns scaled to 1.
    """

    rank: int
    decided: bool
    bits: int
    smallest_pivot: float
    largest_remainder: float
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    seen: tuple[bool, ...]
    exact: bool
    null_space: np.ndarray
    null_basis: np.ndarray


def rank_at(
    matrix: ca.Function,
    arguments: Sequence[Sequence[Number]],
    stages: Sequence[int] | None = None,
    eliminated: int = 0,
    *,
    confirmed: bool = True,
) -> Rank:
    """Return the rank of matrix(arguments) (m, eliminated + n), doubling the precision until it is decided or the limit reached.

    stages: a number per row; pivots come from rows of a lower stage as long as these have any; eliminated, confirmed: see `rank_of`.
    Raises NoValueError where a row has no finite value at any precision, NotExactError.
    """
    graph = instructions(matrix)
    n = matrix.size2_out(0) - eliminated
    return rank_of(lambda: values_at(matrix, arguments, graph), n, eliminated, stages, confirmed=confirmed)


def rank_of(
    rows_at_precision: Callable[[], Rows],
    n: int,
    eliminated: int = 0,
    stages: Sequence[int] | None = None,
    *,
    confirmed: bool = True,
    precisions: Sequence[int] = PRECISIONS,
    most: Bound | None = None,
) -> Rank:
    """Return the rank of rows (m, eliminated + n) that are made anew at each precision, as far as it goes beyond `eliminated` columns.

    It is the rank of the combinations of rows in which the first `eliminated` columns vanish: of those in the other n columns.
    most: what it is at most, by proof; it is decided where it is that, and undecided where it comes out as more, or less.
    Without one, what counts as 0 is thin, and (confirmed) must be so at CONFIRMING bits. precisions: bits, tried in turn.
    Raises NoValueError where a row has no finite value at any precision.
    """
    rank, failed, least_bits = None, [], 0
    for bits in precisions:
        if bits < least_bits:
            continue
        with flint.ctx.workprec(bits):
            rows = rows_at_precision()
            failed = [i for i, row in enumerate(rows) if not all(is_finite(entry) for entry in row)]
            rank = None if failed else _beyond(rows, eliminated, n, stages, most)
        if rank is None or not rank.decided:
            if rank and most and rank.rank > most.rank:
                break
            continue
        if most or not confirmed or bits >= CONFIRMING or (rank.rank == n and not eliminated):
            break
        least_bits = CONFIRMING
    if rank is None:
        raise NoValueError(failed[0], f"row {failed[0]} of the matrix")
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
    failed: list[int] = []
    for bits in PRECISIONS:
        with flint.ctx.workprec(bits):
            rows = values_at(matrix, arguments, graph)
            failed = [i for i, row in enumerate(rows) if not all(is_finite(entry) for entry in row)]
        if not failed:
            return None
    return failed[0]


def _beyond(rows: Rows, eliminated: int, n: int, stages: Sequence[int] | None, most: Bound | None) -> Rank:
    stages = stages or [0] * len(rows)
    if not eliminated:
        return _eliminate(rows, n, stages, most)
    # numbers are scaled before the first elimination: rows by their size, so that thin means the same for all
    rows = [scaled(row, [exponent(row)] * len(row)) for row in rows]
    reduced, pivots, _ = _reduced(rows, range(eliminated), [0] * len(rows))
    left = [i for i in range(len(rows)) if i not in pivots.values()]
    all_entered = most is not None and len(pivots) == most.eliminated  # what is left of these columns is 0, by proof
    kept = [i for i in left if all_entered or _is_free(reduced[i][:eliminated], exactly=most is not None)]
    rank = _eliminate([reduced[i][eliminated:] for i in kept], n, [stages[i] for i in kept], most)
    # a row that is not told to be free of the eliminated columns tells nothing
    decided = rank.decided and (kept == left or rank.rank == n)
    return replace(rank, decided=decided, rows=tuple(kept[i] for i in rank.rows))


def _is_free(entries: Sequence[arb], *, exactly: bool) -> bool:
    """Return whether the entries are 0: exactly, or as far as the precision reaches."""
    return all(entry.is_zero() for entry in entries) if exactly else all(entry.abs_upper() <= _thin() for entry in entries)


def _eliminate(rows: Rows, n: int, stages: Sequence[int], most: Bound | None) -> Rank:
    """Gauss-Jordan elimination with full pivoting within each stage, on rows and columns scaled by powers of 2."""
    rows = [scaled(row, [exponent(row)] * n) for row in rows]
    widths = [exponent([row[j] for row in rows]) for j in range(n)]
    rows, pivots, smallest = _reduced([scaled(row, widths) for row in rows], range(n), stages)
    free = [j for j in range(n) if j not in pivots]
    left = [rows[i][j].abs_upper() for i in range(len(rows)) if i not in pivots.values() for j in free]
    zeros = [rows[i][j].abs_upper() for i in pivots.values() for j in free if 0 in rows[i][j]]
    seen = tuple(j in pivots and all(0 in rows[pivots[j]][k] for k in free) for j in range(n))
    proven = most is None or not free or (len(pivots) == most.rank and most.seen in (None, seen))
    vectors = [_null_vector(rows, pivots, j, widths) for j in free]
    return Rank(
        rank=len(pivots),
        decided=proven and all(size <= _thin() for size in (zeros if most else left + zeros)),
        bits=flint.ctx.prec,
        smallest_pivot=smallest,
        largest_remainder=max(map(float, left), default=0.0),
        rows=tuple(pivots.values()),
        columns=tuple(pivots),
        seen=seen,
        exact=all(size.is_zero() for size in zeros),
        null_space=orthonormal(vectors, n),
        null_basis=np.array([[float(vector[j]) for vector in vectors] for j in range(n)]).reshape(n, len(vectors)),
    )


def _thin() -> arb:
    """What is left around 0 counts as 0 where it is thinner than this."""
    return arb(2) ** (-flint.ctx.prec // 2)


def _reduced(rows: Rows, columns: range, stages: Sequence[int]) -> tuple[Rows, dict[int, int], float]:
    """Return the rows with as many of the columns as possible cleared, {column: row} of the pivots, the smallest of them."""
    pivots: dict[int, int] = {}
    smallest = math.inf
    while pivot := _pivot(rows, pivots, columns, stages):
        row, column = pivot
        smallest = min(smallest, float(rows[row][column].abs_lower()))
        rows = cleared(rows, row, column)
        pivots[column] = row
    return rows, pivots, smallest


def _pivot(rows: Rows, pivots: Mapping[int, int], columns: range, stages: Sequence[int]) -> tuple[int, int] | None:
    """Return row and column of the entry farthest from 0 in the lowest stage with an entry that excludes 0."""
    used = set(pivots.values())
    rows_left = [i for i in range(len(rows)) if i not in used]
    for stage in sorted({stages[i] for i in rows_left}):
        sizes = [(rows[i][j].abs_lower(), i, j) for i in rows_left if stages[i] == stage for j in columns if j not in pivots]
        size, row, column = max(sizes, default=(arb(0), 0, 0))
        if size > 0:
            return row, column
    return None


def _null_vector(rows: Rows, pivots: Mapping[int, int], free: int, widths: Sequence[int]) -> list[arb]:
    """Return the vector (n,) that the pivots' rows annihilate with its free entry not 0, in units of the unscaled columns."""
    vector = [-rows[pivots[j]][free] if j in pivots else arb(int(j == free)) for j in range(len(widths))]
    sized = scaled([arb(0) if 0 in entry else entry for entry in vector], widths)
    return scaled(sized, [exponent(sized)] * len(sized))
