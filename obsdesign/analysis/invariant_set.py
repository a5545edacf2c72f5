"""States that cannot be left: a set of simple shape that holds a state and that no known input leaves, for a bound from above.

At a state x_0 what derivatives tell is what they tell on the whole orbit, and no more than at random states of any set V that holds
the orbit. V is sought among the sets that are affine in x and in the functions cos, sin and exp that occur: equilibria, legs along a
line, circles with the heading tangent, states that stay at their value. The smallest one holds x_0 and the coefficients of the
Taylor series of solutions from it; it is invariant if the rates at its random states point along it (modulo the prime).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import flint
from flint import nmod, nmod_mat

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import Place, random_residues
from obsdesign.analysis.modular_points import residues_of
from obsdesign.analysis.rank_growth import Bounds, growth_modulo
from obsdesign.errors import InputError
from obsdesign.rank.exact_numbers import as_residue
from obsdesign.rank.graph import evaluate, instructions
from obsdesign.rank.residues import values_modulo
from obsdesign.rank.symbols import PRIME
from obsdesign.rank.taylor import Arguments

_SAMPLES = 3
"""So many random states in turn whose rates point along the set show that it is invariant."""

Vector = list[nmod]


def growth_on_invariant(equations: Equations, place: Place, seed: int) -> Bounds | None:
    """Return the growth at random states of an invariant set that holds the place: what there is at most at the place.

    None where none is found. equations: with known inputs alone.
    """
    for functions in (_functions(equations), ca.SX(0, 1)):
        try:
            found = _invariant(_Chart(equations, residues_of(equations, place.state), functions), seed)
            if found:
                return growth_modulo(equations, seed, lambda attempt, found=found: found.place(f"{attempt}"))
        except (_NotSampledError, ZeroDivisionError, InputError):
            continue
    return None


class _NotSampledError(Exception):
    """The relations among functions do not let random states of the set be found."""


def _functions(equations: Equations) -> ca.SX:
    """Return cosine, sine and exp of the arguments that occur, in one column."""
    if equations.is_rational:
        return ca.SX(0, 1)
    found = equations.symbols_used
    entries = ca.vertsplit(found.arguments) if found.arguments.numel() else []
    parts = {"circle": lambda a: ca.vertcat(ca.cos(a), ca.sin(a)), "exp": ca.exp}
    first = {entry.element_hash(): (kind, entry) for kind, entry in reversed(list(zip(found.kinds, entries, strict=True))) if kind in parts}
    return ca.vertcat(ca.SX(0, 1), *(parts[kind](entry) for kind, entry in first.values()))


@dataclass(frozen=True, eq=False)
class _Chart:
    """Coordinates X = (states in no argument, functions, states in arguments), N of them, about a state modulo the prime.

    directions: independent vectors (N,) along which the set extends from the state.
    """

    equations: Equations
    start: Place
    functions: ca.SX
    directions: tuple[Vector, ...] = ()

    @cached_property
    def order(self) -> tuple[int, ...]:
        """The states, those in no argument first."""
        inside = set(ca.jacobian_sparsity(self.functions, self.equations.x).get_col()) if self.functions.numel() else set()
        return (*(i for i in range(self.equations.n) if i not in inside), *sorted(inside))

    @cached_property
    def outside(self) -> int:
        """Number of states in no argument."""
        inside = ca.jacobian_sparsity(self.functions, self.equations.x).get_col() if self.functions.numel() else []
        return self.equations.n - len(set(inside))

    @cached_property
    def coordinates(self) -> ca.SX:
        """X as expressions."""
        states = [self.equations.x[i] for i in self.order]
        return ca.vertcat(ca.SX(0, 1), *states[: self.outside], self.functions, *states[self.outside :])

    @cached_property
    def _point_and_rates(self) -> ca.Function:
        every = ca.jacobian(self.coordinates, self.equations.x) @ ca.horzcat(ca.SX(self.equations.n, 0), *self.equations.fields)
        return self.equations.function(ca.densify(ca.horzcat(self.coordinates, every)))

    def at(self, place: Place) -> tuple[Vector, list[Vector]]:
        """Return X and its rates along drift and known fields."""
        rows = values_modulo(self._point_and_rates, (place.state, self.equations.values), place.arithmetic)
        point, *rates = [list(column) for column in zip(*rows, strict=True)]
        return point, rates

    @cached_property
    def point(self) -> Vector:
        """X of the state."""
        return self.at(self.start)[0]

    def along(self, vectors: Sequence[Vector]) -> _Chart:
        """Return the set that extends along these vectors too."""
        every = [vector for vector in (*self.directions, *vectors) if any(entry != 0 for entry in vector)]
        if not every:
            return self
        reduced, rank = _matrix(every).rref()
        return replace(self, directions=tuple(reduced.tolist()[:rank]))

    @cached_property
    def forms(self) -> list[Vector]:
        """Rows L, in reduced echelon form, with L (X - X_0) = 0 on the set."""
        N = len(self.point)
        if not self.directions:
            return [[nmod(int(i == j), PRIME) for j in range(N)] for i in range(N)]
        columns, nullity = _matrix(self.directions).nullspace()
        if not nullity:
            return []
        reduced, rank = nmod_mat(nullity, N, [columns[i, j] for j in range(nullity) for i in range(N)], PRIME).rref()
        return reduced.tolist()[:rank]

    def place(self, seed: str) -> Place:
        """Return a random state of the set. Raises _NotSampledError."""
        n, outside, between = self.equations.n, self.outside, self.functions.numel()
        drawn = [nmod(value, PRIME) for value in random_residues(n, f"{seed} invariant")]
        X = [*drawn[:outside], *self.point[outside : outside + between], *drawn[outside:]]
        rows = [(next(j for j, entry in enumerate(row) if entry != 0), row) for row in self.forms]
        for pivot, row in rows:
            if pivot >= outside + between:
                X[pivot] = self._solved(row, pivot, X)
        values, _ = self.at(residues_of(self.equations, self._state(X)))
        X[outside : outside + between] = values[outside : outside + between]
        for pivot, row in rows:
            if pivot < outside:
                X[pivot] = self._solved(row, pivot, X)
            elif pivot < outside + between and self._solved(row, pivot, X) != X[pivot]:
                raise _NotSampledError
        return residues_of(self.equations, self._state(X))

    def _solved(self, row: Vector, pivot: int, X: Vector) -> nmod:
        """Return the coordinate of the pivot for which the form vanishes."""
        rest = sum((entry * (X[j] - self.point[j]) for j, entry in enumerate(row) if j != pivot), nmod(0, PRIME))
        return self.point[pivot] - rest

    def _state(self, X: Vector) -> list[int]:
        values = [*X[: self.outside], *X[self.outside + self.functions.numel() :]]
        state = dict(zip(self.order, values, strict=True))
        return [int(state[i]) for i in range(self.equations.n)]

    def series(self, seed: int) -> list[Vector]:
        """Return the coefficients t, t^2, ... of X along a solution from the state under random known inputs."""
        equations, arithmetic, terms = self.equations, self.start.arithmetic, len(self.point) + 3
        inputs = [[as_residue(value) for value in random_residues(terms, f"{seed} along {i}")] for i in range(len(equations.known))]
        constants = [as_residue(value) for value in equations.values]
        states = equations.flow.solution(arithmetic, Arguments([as_residue(v) for v in self.start.state], inputs, [], constants), terms - 1)
        before = flint.ctx.cap
        flint.ctx.cap = terms
        try:
            function = equations.function(ca.densify(self.coordinates))
            values = evaluate(instructions(function), [[arithmetic.series(each) for each in states], constants], arithmetic)
        finally:
            flint.ctx.cap = before
        columns = [([*arithmetic.coefficients(value), *[nmod(0, PRIME)] * terms])[:terms] for value in values]
        return [[column[k] for column in columns] for k in range(1, terms)]


def _matrix(rows: Sequence[Vector]) -> nmod_mat:
    return nmod_mat(len(rows), len(rows[0]), [entry for row in rows for entry in row], PRIME)


def _invariant(chart: _Chart, seed: int) -> _Chart | None:
    """Return the smallest of the sets that is invariant. Raises _NotSampledError."""
    count = 2 if chart.equations.known else 1
    chart = chart.along([vector for k in range(count) for vector in chart.series(seed + k)])
    for attempt in range(len(chart.point) + 1):
        rates = [rate for k in range(_SAMPLES) for rate in chart.at(chart.place(f"{seed} {attempt} {k}"))[1]]
        larger = chart.along(rates)
        if len(larger.directions) == len(chart.directions):
            return chart
        chart = larger
    return None
