"""Arithmetic modulo a prime: exact, with no rounding and no growth. Functions that are not rational are symbols, see `symbols`."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import casadi as ca
from flint import nmod, nmod_mat, nmod_poly

from obsdesign.rank.balls import IRRATIONAL, irrational_part
from obsdesign.rank.elimination import RankBound
from obsdesign.rank.exact_numbers import Number, as_residue
from obsdesign.rank.formal_series import ResidueOperations
from obsdesign.rank.graph import Arithmetic, evaluate, instructions, require_short
from obsdesign.rank.symbols import PRIME, ROOT_OF_PI, Symbols

_IRRATIONAL = dict(zip(IRRATIONAL, (2 * pow(ROOT_OF_PI, -1, PRIME) % PRIME, ROOT_OF_PI * pow(2, -1, PRIME) % PRIME), strict=True))


def _constant(value: float) -> nmod:
    if part := irrational_part(value):
        return as_residue(part[0]) * _IRRATIONAL[part[1]]
    require_short(value)
    return as_residue(Fraction(value))


def modular_arithmetic(symbols: Symbols) -> Arithmetic:
    """Return the arithmetic in which functions that are not rational have the values of the symbols at t = 0.

    Numbers modulo the prime and polynomials in t over them, cut after `flint.ctx.cap` terms.
    """
    return Arithmetic(
        constant=_constant,
        operations=ResidueOperations(symbols).operations(),
        number=as_residue,
        series=lambda coefficients: nmod_poly(list(coefficients), PRIME),
        coefficients=lambda a: a.coeffs() if isinstance(a, nmod_poly) else [a],
        matrix=lambda m, n, entries: nmod_mat(m, n, entries, PRIME),
    )


MODULAR_ARITHMETIC = modular_arithmetic(Symbols())
"""Residues with no relations among symbols but those that hold for one function."""


def modular_matrix(rows: Sequence[Sequence[nmod | int]], n_columns: int) -> nmod_mat:
    """Return rows (m, n_columns) as a matrix modulo the prime."""
    return nmod_mat(len(rows), n_columns, [entry for row in rows for entry in row], PRIME)


def modular_rank(rows: Sequence[Sequence[nmod | int]]) -> int:
    """Return the rank of rows modulo the prime."""
    return modular_matrix(rows, len(rows[0])).rank() if rows and rows[0] else 0


def row_basis(rows: Sequence[Sequence[nmod | int]]) -> list[list[nmod]]:
    """Return a basis of the space that rows span modulo the prime, in reduced echelon form."""
    if not rows:
        return []
    reduced, rank = modular_matrix(rows, len(rows[0])).rref()
    return reduced.tolist()[:rank]


def independent_rows(rows: Sequence[Sequence[nmod]]) -> tuple[int, ...]:
    """Return the first rows that are independent modulo the prime, by index."""
    if not rows or not rows[0]:
        return ()
    reduced, rank = modular_matrix(rows, len(rows[0])).transpose().rref()
    return tuple(next(j for j in range(len(rows)) if reduced[i, j] != 0) for i in range(rank))


def rank_bound(rows: Sequence[Sequence[nmod]], n_columns: int, n_eliminated: int) -> RankBound:
    """Return what the rank of rows (m, width) is beyond the eliminated columns, and which unit covectors are combinations of rows.

    In the reduced echelon form that is a column with a pivot whose row has no other entry.
    """
    n = n_columns - n_eliminated
    echelon = row_basis(rows)
    pivots = [next(j for j in range(n_columns) if row[j] != 0) for row in echelon]
    unit_columns = {pivot for row, pivot in zip(echelon, pivots, strict=True) if all(row[j] == 0 for j in range(pivot + 1, n_columns))}
    rank_eliminated = sum(pivot < n_eliminated for pivot in pivots)
    return RankBound(len(echelon) - rank_eliminated, rank_eliminated, tuple(n_eliminated + j in unit_columns for j in range(n)))


def values_modulo(
    function: ca.Function, arguments: Sequence[Sequence[Number]], arithmetic: Arithmetic = MODULAR_ARITHMETIC
) -> list[list[nmod]]:
    """Return the matrix (m, n) modulo the prime; raises ZeroDivisionError at a pole."""
    shape = function.sparsity_out(0)
    rows = [[nmod(0, PRIME)] * shape.size2() for _ in range(shape.size1())]
    numbers = [[as_residue(value) for value in argument] for argument in arguments]
    values = evaluate(instructions(function), numbers, arithmetic)
    for entry, i, j in zip(values, shape.row(), shape.get_col(), strict=True):
        rows[i][j] = entry
    return rows
