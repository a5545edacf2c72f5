"""Arithmetic modulo a prime: exact, with no rounding and no growth, for quotients of polynomials."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction

import casadi as ca
import flint
from flint import arb, nmod, nmod_mat, nmod_poly

from obsdesign.rank.balls import Number
from obsdesign.rank.graph import Arithmetic, NotExactError, evaluate, instructions, require_short

PRIME = 2**61 - 1
"""A Mersenne prime: what is not 0 modulo it is not 0; what is 0 modulo it at a random point is 0 but for a chance of degree / 2^61."""

Residue = nmod | nmod_poly


def as_residue(value: Number) -> nmod:
    """Return the number modulo the prime; raises ZeroDivisionError where the prime divides its denominator."""
    if isinstance(value, arb):
        raise NotExactError(f"{value} is a ball: it has no residue")
    return nmod(value.numerator, PRIME) / nmod(value.denominator, PRIME)


def _product(a: Residue, b: Residue) -> Residue:
    return a.mul_low(b, flint.ctx.cap) if isinstance(a, nmod_poly) and isinstance(b, nmod_poly) else a * b


def _inverse(a: Residue) -> Residue:
    if isinstance(a, nmod):
        return 1 / a
    if a[0] == 0:  # flint would end the process
        raise ZeroDivisionError("a series without constant term has no inverse")
    return a.inverse_series_trunc(flint.ctx.cap)


_OPERATIONS: Mapping[int, Callable[..., Residue]] = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: _product,
    ca.OP_DIV: lambda a, b: _product(a, _inverse(b)),
    ca.OP_NEG: lambda a: -a,
    ca.OP_INV: _inverse,
    ca.OP_SQ: lambda a: _product(a, a),
    ca.OP_TWICE: lambda a: a + a,
}


def _constant(value: float) -> nmod:
    require_short(value)
    return as_residue(Fraction(value))


RESIDUES = Arithmetic(
    constant=_constant,
    operations=_OPERATIONS,
    number=as_residue,
    series=lambda coefficients: nmod_poly(list(coefficients), PRIME),
    coefficients=lambda a: a.coeffs() if isinstance(a, nmod_poly) else [a],
    matrix=lambda m, n, entries: nmod_mat(m, n, entries, PRIME),
)
"""Numbers modulo the prime and polynomials in t over them, cut after `flint.ctx.cap` terms."""


def independent_rows(rows: Sequence[Sequence[nmod]]) -> tuple[int, ...]:
    """Return the first rows that are independent modulo the prime, by index."""
    if not rows or not rows[0]:
        return ()
    columns = nmod_mat(len(rows), len(rows[0]), [entry for row in rows for entry in row], PRIME).transpose()
    reduced, rank = columns.rref()
    return tuple(next(j for j in range(len(rows)) if reduced[i, j] != 0) for i in range(rank))


def values_modulo(function: ca.Function, arguments: Sequence[Sequence[Number]]) -> list[list[nmod]]:
    """Return the matrix (m, n) modulo the prime; raises ZeroDivisionError at a pole."""
    shape = function.sparsity_out(0)
    rows = [[nmod(0, PRIME)] * shape.size2() for _ in range(shape.size1())]
    residues = [[as_residue(value) for value in argument] for argument in arguments]
    for entry, i, j in zip(evaluate(instructions(function), residues, RESIDUES), shape.row(), shape.get_col(), strict=True):
        rows[i][j] = entry
    return rows
