"""Vector fields of the state that may be symmetries: in doubles at a point, and exactly modulo the prime."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice

import casadi as ca
import numpy as np
from flint import nmod

from obsdesign.analysis.codistribution import Codistribution, CodistributionSample
from obsdesign.analysis.equations import Equations
from obsdesign.rank.exact_numbers import ExactNumber, as_residue
from obsdesign.rank.residues import values_modulo
from obsdesign.rank.symbols import PRIME

_N_SAMPLES = 3  # random places at which a field must annihilate: one is enough but for a chance of degree / PRIME


class AbstractVectorField(ABC):
    """A change of the state that depends on the state."""

    @abstractmethod
    def at(self, x: np.ndarray) -> np.ndarray:
        """Return the vector (n,) at the state (n,)."""

    @abstractmethod
    def modulo_prime(self, sample: CodistributionSample) -> Sequence[nmod]:
        """Return the vector (n,) at a place modulo the prime. Raises ZeroDivisionError at a pole."""


@dataclass(frozen=True)
class AffineField(AbstractVectorField):
    """v(x) = A x + b in n states; terms: (i, j, A_ij) and (i, None, b_i), all that are not 0."""

    n: int
    terms: tuple[tuple[int, int | None, ExactNumber], ...]

    def at(self, x: np.ndarray) -> np.ndarray:
        """Return A x + b (n,)."""
        vector = np.zeros(self.n)
        for i, j, coefficient in self.terms:
            vector[i] += float(coefficient) * (1.0 if j is None else x[j])
        return vector

    def modulo_prime(self, sample: CodistributionSample) -> Sequence[nmod]:
        """Return A x + b (n,) modulo the prime."""
        vector = [nmod(0, PRIME)] * self.n
        for i, j, coefficient in self.terms:
            factor = (
                coefficient.numerator if isinstance(coefficient, Fraction) and coefficient.denominator == 1 else as_residue(coefficient)
            )
            vector[i] += factor if j is None else factor * sample.x[j]
        return vector

    @property
    def A(self) -> tuple[tuple[Fraction, ...], ...]:
        """The matrix (n, n)."""
        entries = {(i, j): coefficient for i, j, coefficient in self.terms if j is not None}
        return tuple(tuple(_as_fraction(entries.get((i, j), Fraction(0))) for j in range(self.n)) for i in range(self.n))

    @property
    def rows(self) -> tuple[int, ...]:
        """The states that change."""
        return tuple(sorted({i for i, _, _ in self.terms}))

    @property
    def is_constant(self) -> bool:
        """Whether A = 0."""
        return all(j is None for _, j, _ in self.terms)

    @property
    def is_diagonal(self) -> bool:
        """Whether b = 0 and A is diagonal."""
        return all(i == j for i, j, _ in self.terms)


def _as_fraction(value: ExactNumber) -> Fraction:
    return value if isinstance(value, Fraction) else Fraction(float(value))


@dataclass(frozen=True, eq=False)
class ExpressionField(AbstractVectorField):
    """v as an expression (n, 1) of the equations' state and constants."""

    equations: Equations
    expression: ca.SX

    def at(self, x: np.ndarray) -> np.ndarray:
        """Return the vector (n,) at the state that was asked about."""
        origin = np.array([float(turn) * np.pi for turn in self.equations.origin or np.zeros(len(x))])
        constants = [float(value) for value in self.equations.values]
        return np.asarray(self.equations.function(self.expression)(x - origin, constants), dtype=float).ravel()

    def modulo_prime(self, sample: CodistributionSample) -> Sequence[nmod]:
        """Return the vector (n,) modulo the prime."""
        function = self.equations.function(ca.densify(self.expression))
        values = values_modulo(function, (sample.place.state, self.equations.values), sample.place.arithmetic)
        return [row[0] for row in values]


def is_symmetry(vector_field: AbstractVectorField, codistribution: Codistribution) -> bool:
    """Return whether the field annihilates what is known of dx, at several random places: moving along it changes no output."""
    try:
        return all(sample.annihilates(vector_field.modulo_prime(sample)) for sample in islice(codistribution.samples(), _N_SAMPLES))
    except ArithmeticError:  # a pole, or no random place shows all of what is known
        return False
