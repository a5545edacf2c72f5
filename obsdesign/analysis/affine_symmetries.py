"""Affine vector fields A x + b that move no output, as the solutions of linear equations at random places: no name is needed for it.

Sum_k c_k v_k annihilates what is known of dx everywhere iff Q(x) (v_1(x), v_2(x), ...) c = 0 at all x, Q the covectors there. If the
equations of one more random place leave the solutions as they were, these solve them at every place.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import islice

from flint import nmod

from obsdesign.analysis.codistribution import Codistribution, CodistributionSample
from obsdesign.analysis.vector_fields import AffineField
from obsdesign.rank.exact_numbers import ExactNumber, as_residue, negate
from obsdesign.rank.residues import row_basis
from obsdesign.rank.symbols import PRIME

Monomial = tuple[int, int | None]
"""The field x_j e_i, or (i, None) = e_i."""

MAX_MONOMIALS = 700
"""So many unknowns are solved for: 25 states of which none is seen, or fewer that are not seen of more."""
_LONGEST_NUMERATOR, _LONGEST_DENOMINATOR = 10**6, 10**4


def constant_fields(codistribution: Codistribution, unseen: Sequence[int]) -> list[AffineField]:
    """Return a basis of the constant vectors that move no output."""
    return _annihilating_fields(codistribution, [(i, None) for i in unseen])


def scaling_fields(codistribution: Codistribution, unseen: Sequence[int]) -> list[AffineField]:
    """Return a basis of the diagonal fields (a_i x_i) that move no output."""
    return _annihilating_fields(codistribution, [(i, i) for i in unseen])


def affine_fields(codistribution: Codistribution, unseen: Sequence[int], marks: Sequence[ExactNumber] = ()) -> list[AffineField]:
    """Return a basis of the affine fields that move no output and change the given states alone; none where there are too many to try.

    marks: numbers that need not be short, such as the places of landmarks.
    """
    n = codistribution.n
    monomials: list[Monomial] = [(i, j) for i in unseen for j in (*range(n), None)]
    return _annihilating_fields(codistribution, monomials, marks) if len(monomials) <= MAX_MONOMIALS else []


def _annihilating_fields(
    codistribution: Codistribution, monomials: Sequence[Monomial], marks: Sequence[ExactNumber] = ()
) -> list[AffineField]:
    """Return a basis of the combinations of fields that annihilate what is known of dx everywhere, those with exact coefficients."""
    names: dict[int, ExactNumber] = {int(as_residue(mark)): mark for value in marks for mark in (value, negate(value))}
    fields: list[AffineField] = []
    for solution in _solutions(codistribution, monomials):
        places = [k for k, value in enumerate(solution) if int(value)]
        coefficients = [names.get(int(solution[k]), _short_fraction(solution[k])) for k in places]
        terms = [(*monomials[k], value) for k, value in zip(places, coefficients, strict=True) if value is not None]
        if len(terms) == len(places):
            fields.append(AffineField(codistribution.n, tuple(terms)))
    return fields


def _solutions(codistribution: Codistribution, monomials: Sequence[Monomial]) -> list[list[nmod]]:
    """Return a basis of the combinations that annihilate everywhere, each with a field of its own that the others do not have."""
    samples, width = codistribution.samples(), len(monomials)
    rows: list[list[nmod]] = []
    nullity, batch = width, -(-width // codistribution.dimension)
    while nullity:
        for sample in islice(samples, batch):
            rows += _rows(sample, monomials)
        rows = row_basis(rows)
        if len(rows) == width:
            return []
        if width - len(rows) == nullity:
            return _null_vectors(rows, width)
        nullity, batch = width - len(rows), 1
    return []


def _rows(sample: CodistributionSample, monomials: Sequence[Monomial]) -> list[list[nmod]]:
    """Return what is known of the change along each of the fields (r, width)."""
    factors = [(i, nmod(1, PRIME) if j is None else sample.x[j]) for i, j in monomials]
    return [[row[i] * factor for i, factor in factors] for row in sample.covectors.tolist()]


def _null_vectors(rows: Sequence[Sequence[nmod]], width: int) -> list[list[nmod]]:
    """Return a basis of what rows in reduced echelon form annihilate, each with a free column of its own."""
    pivots = [next(j for j in range(width) if int(row[j])) for row in rows]
    return [
        [-rows[pivots.index(j)][free] if j in pivots else nmod(int(j == free), PRIME) for j in range(width)]
        for free in range(width)
        if free not in pivots
    ]


def _short_fraction(value: nmod) -> Fraction | None:
    """Return the short fraction that a residue stands for, if there is one: by Euclid's algorithm, cut in the middle."""
    remainder, last_remainder, factor, last_factor = int(value), PRIME, 1, 0
    while remainder > _LONGEST_NUMERATOR:
        quotient = last_remainder // remainder
        remainder, last_remainder = last_remainder - quotient * remainder, remainder
        factor, last_factor = last_factor - quotient * factor, factor
    if abs(factor) > _LONGEST_DENOMINATOR:
        return None
    return Fraction(remainder, factor)
