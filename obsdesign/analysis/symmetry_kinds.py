"""What an affine vector field is: a shift, a rotation, a scale, a gauge of a sum or of a product."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from obsdesign.analysis.symmetry import Symmetry, SymmetryKind
from obsdesign.analysis.vector_fields import AffineField
from obsdesign.signals import Point, Signal

_LONGEST_DENOMINATOR = 1000  # of the square of a frequency
_ANGULAR_UNITS = ("", "rad", "deg")  # of what may be an angle; "": nobody said


def affine_symmetry(field: AffineField, states: Sequence[Signal], at: np.ndarray) -> Symmetry:
    """Return the field, which moves no output, as what it is."""
    kind = _kind(field, states)
    A, b = np.array(field.A, dtype=float), field.at(np.zeros(field.n))
    centre = _centre(A, b, states) if kind in {SymmetryKind.ROTATION, SymmetryKind.SCALE} else None
    return Symmetry(kind, tuple(states[i].name for i in field.rows), field.at(at), A, b, centre)


def _kind(field: AffineField, states: Sequence[Signal]) -> SymmetryKind:
    coefficients = {coefficient for *_, coefficient in field.terms}
    if field.is_constant:
        if len(field.rows) == 1:
            return SymmetryKind.UNSEEN
        is_common = len(coefficients) == 1 and len({states[i].unit for i in field.rows}) == 1
        return SymmetryKind.SHIFT if is_common and len(field.rows) > 2 else SymmetryKind.SUM
    if field.is_diagonal:
        is_plane = {states[i].name for i in field.rows} == {"x", "y"}
        return SymmetryKind.SCALE if len(coefficients) == 1 and (len(field.rows) > 2 or is_plane) else SymmetryKind.PRODUCT
    if _is_rotation(field.A):
        is_screw = any(states[i].unit not in _ANGULAR_UNITS for i in _rows_at_constant_rate(field))
        return SymmetryKind.LINEAR if is_screw else SymmetryKind.ROTATION
    return SymmetryKind.SCALE if _is_scale(field) else SymmetryKind.LINEAR


def _rows_at_constant_rate(field: AffineField) -> set[int]:
    """Return the states that change alike everywhere: where others are turned, angles that turn with them, or lengths along an axis."""
    return set(field.rows) - {i for i, j, _ in field.terms if j is not None}


def _is_scale(field: AffineField) -> bool:
    """Return whether all that changes is scaled alike about some centre."""
    factors = {(i, j): value for i, j, value in field.terms if j is not None}
    return all(i == j for i, j in factors) and len(set(factors.values())) == 1 and {i for i, _ in factors} == set(field.rows)


def _is_rotation(matrix: Sequence[Sequence[Fraction]]) -> bool:
    """Return whether exp(A t) turns planes and leaves the rest: A prod_k (A^2 + omega_k^2) = 0, over different omega_k^2 > 0."""
    changed = [i for i, row in enumerate(matrix) if any(row) or any(other[i] for other in matrix)]
    A = np.array([[matrix[i][j] for j in changed] for i in changed], dtype=object)
    eigenvalues = np.linalg.eigvals(A.astype(float))
    squares = {Fraction(float(-(value**2).real)).limit_denominator(_LONGEST_DENOMINATOR) for value in eigenvalues if abs(value) > 1e-6}
    if not squares or min(squares) <= 0:
        return False
    product = A
    for square in squares:
        product = product @ (
            A @ A + square * np.array([[Fraction(int(i == j)) for j in range(len(A))] for i in range(len(A))], dtype=object)
        )
    return not product.any()


def _centre(A: np.ndarray, b: np.ndarray, states: Sequence[Signal]) -> Point | None:
    """Return the point (x, y) that stays where it is; None for the origin, and where there are no states x and y that are turned."""
    names = [signal.name for signal in states]
    if not {"x", "y"} <= set(names):
        return None
    rows = [names.index("x"), names.index("y")]
    block = A[np.ix_(rows, rows)]
    if np.linalg.det(block) == 0 or not b[rows].any():
        return None
    x, y = np.linalg.solve(block, -b[rows])
    return float(x) + 0.0, float(y) + 0.0  # no -0
