"""What is known of the state, at random places modulo the prime: a vector field that annihilates it everywhere moves no output.

A field that annihilates the codistribution at a random place does so everywhere, but for a chance of degree / PRIME; and the
codistribution modulo the prime is at least the true one: see docs/verdicts.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from flint import nmod, nmod_mat

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import EvaluationPoint, random_residues
from obsdesign.analysis.experiments import Experiments
from obsdesign.analysis.modular_points import random_modular_point
from obsdesign.rank.exact_numbers import as_residue, pi_times
from obsdesign.rank.residues import modular_matrix, row_basis
from obsdesign.rank.symbols import PRIME, Symbols, pseudorandom

_ATTEMPTS = 5  # random places tried: another one is needed only where something has no value, such as 1 / 0


@dataclass(frozen=True, eq=False)
class CodistributionSample:
    """One random place modulo the prime, and the covectors (r, n) that span what is known of dx there.

    x (n,): the place in the states that were asked about; place: the same as the equations have it.
    """

    x: tuple[nmod, ...]
    covectors: nmod_mat
    place: EvaluationPoint

    def annihilates(self, vector: Sequence[nmod]) -> bool:
        """Return whether a change of the state along the vector (n,) changes nothing that is known."""
        product = self.covectors * nmod_mat(len(vector), 1, list(vector), PRIME)
        return not any(int(entry) for entry in product.entries())


class NoSampleError(ArithmeticError):
    """No random place modulo the prime shows all of what is known."""


@dataclass(frozen=True, eq=False)
class Codistribution:
    """What is known of dx from derivatives up to an order, in so many experiments: of the given dimension, at generic states."""

    equations: Equations
    order: int
    count: int
    dimension: int
    seed: int
    sample_cache: dict[int, CodistributionSample] = field(default_factory=dict[int, CodistributionSample], repr=False)

    @property
    def n(self) -> int:
        """Number of states that are asked about."""
        return self.equations.n_queried

    def samples(self) -> Iterator[CodistributionSample]:
        """Yield random places without end. Raises NoSampleError where none is found at which as much is known."""
        k = 0
        while True:
            if k not in self.sample_cache:
                self.sample_cache[k] = self._sample(pseudorandom("sample", self.seed, k))
            yield self.sample_cache[k]
            k += 1

    def _sample(self, seed: int) -> CodistributionSample:
        for attempt in range(_ATTEMPTS):
            place = _random_place(self.equations, seed + attempt)
            # another seed is another unknown input: what is known holds for all of them
            experiments = Experiments(self.equations, place, self.order, self.count, seed)
            try:
                covectors = _covectors(experiments)
            except ZeroDivisionError:
                continue
            if covectors.nrows() == self.dimension:
                return CodistributionSample(self._original_state(place), covectors, place)
        raise NoSampleError

    def _original_state(self, place: EvaluationPoint) -> tuple[nmod, ...]:
        origin = self.equations.origin or (Fraction(0),) * self.equations.n
        state = [as_residue(value) + as_residue(pi_times(turn)) for value, turn in zip(place.state, origin, strict=True)]
        return tuple(state[self.equations.n_added :])


def codistribution_of(equations: Equations, dimension: int, seed: int, *, smooth: bool) -> Codistribution | None:
    """Return what is known of dx at generic states, from as few derivatives as show the dimension; None where they do not.

    smooth: the known inputs are one smooth signal, not any, switching ones included.
    """
    if not dimension:
        return None
    for attempt in range(_ATTEMPTS):
        try:
            return _lowest_orders(equations, dimension, seed + attempt, smooth=smooth)
        except ZeroDivisionError:
            continue
    return None


def _lowest_orders(equations: Equations, dimension: int, seed: int, *, smooth: bool) -> Codistribution | None:
    place, limit, orders = _random_place(equations, seed), 2 * equations.n + 2, 2
    while True:
        experiments = Experiments(equations, place, min(orders, limit), seed=seed)
        if equations.known_fields and (equations.unknown_fields or equations.step_map) and not smooth:
            experiments = experiments.complete()
        for order in range(experiments.orders + 1):
            if experiments.dimension(order) == dimension:
                return Codistribution(equations, order, experiments.count, dimension, seed)
        if orders >= limit:
            return None
        orders *= 2


def _covectors(experiments: Experiments) -> nmod_mat:
    """Return covectors (r, n) that span the combinations of rows without a part in inputs and added states."""
    rows, n_eliminated = experiments.rows(), experiments.n_eliminated
    free_rows = [row[n_eliminated:] for row in row_basis(rows) if not any(int(entry) for entry in row[:n_eliminated])]
    return modular_matrix(free_rows, experiments.n_columns - n_eliminated)


def _random_place(equations: Equations, seed: int) -> EvaluationPoint:
    """Return a random state modulo the prime; of a map one at which functions are symbols without relations, as it has many states."""
    if equations.step_map is None:
        return random_modular_point(equations, seed)
    return EvaluationPoint(tuple(random_residues(equations.n, seed)), Symbols())
