"""Which symmetries hide the state: named ones first, of few states, each proven to annihilate what is known of the state everywhere."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from obsdesign.analysis.affine_symmetries import affine_fields, constant_fields, scaling_fields
from obsdesign.analysis.codistribution import Codistribution
from obsdesign.analysis.motion_symmetries import forcing_fields, motion_fields
from obsdesign.analysis.sparse_directions import circuits_of, directions_rank
from obsdesign.analysis.symmetry import Symmetry, SymmetryKind
from obsdesign.analysis.symmetry_kinds import affine_symmetry
from obsdesign.analysis.vector_fields import AffineField, is_symmetry
from obsdesign.dynamics.model import Model
from obsdesign.rank.decimal_reading import read_double
from obsdesign.rank.exact_numbers import ExactNumber

_LONGEST_DENOMINATOR = 10_000
_ORDER = tuple(SymmetryKind)


def symmetries_of(codistribution: Codistribution, model: Model, unseen: Sequence[int], at: np.ndarray, count: int) -> tuple[Symmetry, ...]:
    """Return symmetries with independent vectors at the state `at` (n,), `count` of them where there are as many.

    unseen: the states that change along some hidden direction.
    """
    search = _Search(codistribution, model, tuple(unseen), at)
    chosen: list[Symmetry] = []
    for symmetry in search.candidates():
        if len(chosen) == count:
            break
        vectors = [*(each.vector for each in chosen), symmetry.vector]
        if symmetry.vector.any() and set(np.flatnonzero(symmetry.vector)) <= set(unseen) and directions_rank(vectors) > len(chosen):
            chosen.append(symmetry)
    return tuple(sorted(chosen, key=lambda symmetry: _ORDER.index(symmetry.kind)))


@dataclass(frozen=True, eq=False)
class _Search:
    """What is known of the state, and where the vectors of the symmetries are asked for."""

    codistribution: Codistribution
    model: Model
    unseen: tuple[int, ...]
    at: np.ndarray

    def candidates(self) -> Iterator[Symmetry]:
        """Yield symmetries, the simplest first; what takes long is done when it is asked for."""
        alone = [field for field in (self._unit(i) for i in self.unseen) if is_symmetry(field, self.codistribution)]
        yield from map(self._as_symmetry, alone)
        rest = [i for i in self.unseen if i not in {field.rows[0] for field in alone}]
        translations = constant_fields(self.codistribution, rest)
        yield from map(self._as_symmetry, self._sparse(translations))
        yield from map(self._as_symmetry, self._sparse(scaling_fields(self.codistribution, rest)))
        has_rates = self.codistribution.equations.step_map is None and not self.codistribution.equations.n_added
        if has_rates:
            yield from self._forcing(rest)
        pivots = [translation.rows[-1] for translation in translations]
        for candidate in affine_fields(self.codistribution, [i for i in rest if i not in pivots], self._marks):
            yield self._as_symmetry(without_pivots(candidate, translations))
        if has_rates:
            yield from self._motions()

    def _as_symmetry(self, field: AffineField) -> Symmetry:
        return affine_symmetry(field, self.model.states, self.at)

    def _unit(self, i: int) -> AffineField:
        return AffineField(len(self.at), ((i, None, Fraction(1)),))

    def _sparse(self, fields: Sequence[AffineField]) -> list[AffineField]:
        """Return combinations of few terms, of constant or of diagonal fields: those that vanish on all but one of so many states."""
        if not fields:
            return []
        is_constant, ones = fields[0].is_constant, np.ones(len(self.at))
        circuits = circuits_of(np.array([field.at(ones) for field in fields]).T)
        circuits.sort(key=lambda vector: (np.count_nonzero(vector), [not value for value in vector]))
        every = [
            AffineField(len(vector), tuple((int(i), None if is_constant else int(i), _short(vector[i])) for i in np.flatnonzero(vector)))
            for vector in (circuit / circuit[np.flatnonzero(circuit)[0]] for circuit in circuits)
        ]
        return [field for field in every if is_symmetry(field, self.codistribution)]

    def _forcing(self, unseen: Sequence[int]) -> Iterator[Symmetry]:
        for state, field in forcing_fields(self.codistribution.equations, unseen):
            if is_symmetry(field, self.codistribution):
                vector = field.at(self.at)
                changed = [state, *(int(i) for i in np.flatnonzero(vector) if i != state)]
                yield Symmetry(SymmetryKind.FORCING, tuple(self.model.state_names[i] for i in changed), vector)

    def _motions(self) -> Iterator[Symmetry]:
        for name, field in motion_fields(self.codistribution.equations):
            if is_symmetry(field, self.codistribution):
                vector = field.at(self.at)
                changed = tuple(self.model.state_names[int(i)] for i in np.flatnonzero(vector))
                yield Symmetry(SymmetryKind.MOTION, changed, vector, motion=name)

    @property
    def _marks(self) -> list[ExactNumber]:
        """The coordinates of landmarks."""
        return [read_double(float(value)).intended for point in self.model.landmarks for value in point]


def _short(value: float) -> Fraction:
    return Fraction(value).limit_denominator(_LONGEST_DENOMINATOR)


def without_pivots(field: AffineField, translations: Sequence[AffineField]) -> AffineField:
    """Return the field, which does not change the last state of any translation, plus multiples of these: none depends on those states.

    What was turned about a point of the state is turned about the origin. The field as it is where there are no such multiples.
    """
    matrix = {(i, j): value for i, j, value in field.terms if isinstance(value, Fraction)}
    pivots, terms = [translation.rows[-1] for translation in translations], dict(matrix)
    for translation in translations:
        weights = {i: value for i, _, value in translation.terms if isinstance(value, Fraction)}
        for pivot in pivots:
            multiples = {-matrix[i, pivot] / weight for i, weight in weights.items() if (i, pivot) in matrix}
            if len(multiples) == 1:
                (multiple,) = multiples
                for i, weight in weights.items():
                    terms[i, pivot] = terms.get((i, pivot), Fraction(0)) + multiple * weight
    shifted = AffineField(field.n, tuple((i, j, value) for (i, j), value in terms.items() if value))
    is_free = len(matrix) == len(field.terms) and not any(j in pivots for i, j, _ in shifted.terms if i not in pivots)
    return shifted if is_free else field
