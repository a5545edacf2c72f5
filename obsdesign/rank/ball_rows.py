"""Rows of balls: scaled by powers of 2, cleared of a column, made orthonormal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from flint import arb

Rows = list[list[arb]]


def max_exponent(entries: Sequence[arb]) -> int:
    """Return the least e with |entry| <= 2^e, as far as the entries exclude 0: balls around 0 are not blown up."""
    mantissa, exponent = max((entry.abs_lower() for entry in entries), default=arb(0)).man_exp()
    return int(exponent) + int(mantissa).bit_length()


def scale_row(row: Sequence[arb], exponents: Sequence[int]) -> list[arb]:
    """Return the row with entry j divided by 2^exponents[j], exactly."""
    return [entry * arb((1, -exponent)) for entry, exponent in zip(row, exponents, strict=True)]


def clear_column(rows: Rows, row: int, column: int) -> Rows:
    """Return the rows with the pivot made 1 and the rest of its column exactly 0."""
    unit = [arb(1) if j == column else entry / rows[row][column] for j, entry in enumerate(rows[row])]
    return [
        unit if i == row else vector if vector[column].is_zero() else _subtract_row(vector, column, unit) for i, vector in enumerate(rows)
    ]


def _subtract_row(vector: list[arb], column: int, unit: list[arb]) -> list[arb]:
    factor = vector[column]
    return [arb(0) if j == column else entry - factor * unit[j] for j, entry in enumerate(vector)]


def orthonormal_basis(vectors: Sequence[list[arb]], n: int) -> np.ndarray:
    """Return an orthonormal basis (n, d) of the span of d independent vectors (n,), each entry to double precision.

    An entry that is not told from 0 is 0.
    """
    basis: list[list[arb]] = []
    for vector in _separate(vectors):
        remainder = vector
        for unit in basis:
            component = _dot(unit, remainder)
            remainder = [entry - component * unit_entry for entry, unit_entry in zip(remainder, unit, strict=True)]
        norm = _dot(remainder, remainder).sqrt()
        basis.append([entry / norm for entry in remainder])
    return np.array([[0.0 if 0 in vector[j] else float(vector[j]) for vector in basis] for j in range(n)]).reshape(n, len(vectors))


def _separate(vectors: Sequence[list[arb]]) -> Rows:
    """Return a basis of the same span in which each vector has an entry 1 where the others have 0.

    Vectors that are all but parallel, (1, 1e-100, 0) and (1, 0, 1e-100), are told apart by that; by inner products only at twice
    the digits.
    """
    rows = list(vectors)
    for i in range(len(rows)):
        row = rows[i]
        rows = clear_column(rows, i, max(range(len(row)), key=lambda j: row[j].abs_lower()))
        rows = [scale_row(vector, [max_exponent(vector)] * len(vector)) for vector in rows]
    return rows


def _dot(first: list[arb], second: list[arb]) -> arb:
    return sum((a * b for a, b in zip(first, second, strict=True)), arb(0))
