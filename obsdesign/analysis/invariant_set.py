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
from flint import nmod

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import EvaluationPoint, random_residues
from obsdesign.analysis.modular_points import modular_point
from obsdesign.analysis.rank_growth import ModularGrowth, modular_growth
from obsdesign.errors import InputError
from obsdesign.rank.exact_numbers import as_residue
from obsdesign.rank.graph import evaluate, instructions
from obsdesign.rank.residues import modular_matrix, row_basis, values_modulo
from obsdesign.rank.symbols import PRIME
from obsdesign.rank.taylor import FlowArguments

_SAMPLES_PER_TEST = 3
"""So many random states in turn whose rates point along the set show that it is invariant."""

Vector = list[nmod]


def growth_on_invariant(equations: Equations, point: EvaluationPoint, seed: int) -> ModularGrowth | None:
    """Return the growth at random states of an invariant set that holds the place: what there is at most at the place.

    None where none is found. equations: with known inputs alone.
    """
    for functions in (_transcendental_functions(equations), ca.SX(0, 1)):
        try:
            chart = _smallest_invariant(_Chart(equations, modular_point(equations, point.state), functions), seed)
            if chart:
                return modular_growth(equations, seed, lambda attempt, chart=chart: chart.random_point(f"{attempt}"))
        except (_NotSampledError, ZeroDivisionError, InputError):
            continue
    return None


class _NotSampledError(Exception):
    """The relations among functions do not let random states of the set be found."""


def _transcendental_functions(equations: Equations) -> ca.SX:
    """Return cosine, sine and exp of the arguments that occur, in one column."""
    if equations.is_rational:
        return ca.SX(0, 1)
    symbols_used = equations.symbols_used
    entries = ca.vertsplit(symbols_used.arguments) if symbols_used.arguments.numel() else []
    expressions = {"circle": lambda a: ca.vertcat(ca.cos(a), ca.sin(a)), "exp": ca.exp}
    first = {
        entry.element_hash(): (kind, entry)
        for kind, entry in reversed(list(zip(symbols_used.kinds, entries, strict=True)))
        if kind in expressions
    }
    return ca.vertcat(ca.SX(0, 1), *(expressions[kind](entry) for kind, entry in first.values()))


@dataclass(frozen=True, eq=False)
class _Chart:
    """Coordinates X = (states in no argument, functions, states in arguments), N of them, about a state modulo the prime.

    directions: independent vectors (N,) along which the set extends from the state.
    """

    equations: Equations
    start: EvaluationPoint
    functions: ca.SX
    directions: tuple[Vector, ...] = ()

    @cached_property
    def state_order(self) -> tuple[int, ...]:
        """The states, those in no argument first."""
        inside = set(ca.jacobian_sparsity(self.functions, self.equations.x).get_col()) if self.functions.numel() else set()
        return (*(i for i in range(self.equations.n) if i not in inside), *sorted(inside))

    @cached_property
    def n_outside(self) -> int:
        """Number of states in no argument."""
        inside = ca.jacobian_sparsity(self.functions, self.equations.x).get_col() if self.functions.numel() else []
        return self.equations.n - len(set(inside))

    @cached_property
    def coordinates(self) -> ca.SX:
        """X as expressions."""
        states = [self.equations.x[i] for i in self.state_order]
        return ca.vertcat(ca.SX(0, 1), *states[: self.n_outside], self.functions, *states[self.n_outside :])

    @cached_property
    def _evaluate(self) -> ca.Function:
        rates = ca.jacobian(self.coordinates, self.equations.x) @ ca.horzcat(
            ca.SX(self.equations.n, 0), *self.equations.drift_and_known_fields
        )
        return self.equations.function(ca.densify(ca.horzcat(self.coordinates, rates)))

    def coordinates_and_rates(self, point: EvaluationPoint) -> tuple[Vector, list[Vector]]:
        """Return X and its rates along drift and known fields."""
        rows = values_modulo(self._evaluate, (point.state, self.equations.values), point.arithmetic)
        coordinates, *rates = [list(column) for column in zip(*rows, strict=True)]
        return coordinates, rates

    @cached_property
    def start_coordinates(self) -> Vector:
        """X of the state."""
        return self.coordinates_and_rates(self.start)[0]

    def extend_along(self, vectors: Sequence[Vector]) -> _Chart:
        """Return the set that extends along these vectors too."""
        spanning = [vector for vector in (*self.directions, *vectors) if any(entry != 0 for entry in vector)]
        if not spanning:
            return self
        return replace(self, directions=tuple(row_basis(spanning)))

    @cached_property
    def linear_forms(self) -> list[Vector]:
        """Rows L, in reduced echelon form, with L (X - X_0) = 0 on the set."""
        N = len(self.start_coordinates)
        if not self.directions:
            return [[nmod(int(i == j), PRIME) for j in range(N)] for i in range(N)]
        columns, nullity = modular_matrix(self.directions, N).nullspace()
        return row_basis([[columns[i, j] for i in range(N)] for j in range(nullity)])

    def random_point(self, seed: str) -> EvaluationPoint:
        """Return a random state of the set. Raises _NotSampledError."""
        n, n_outside, n_functions = self.equations.n, self.n_outside, self.functions.numel()
        residues = [nmod(value, PRIME) for value in random_residues(n, f"{seed} invariant")]
        X = [*residues[:n_outside], *self.start_coordinates[n_outside : n_outside + n_functions], *residues[n_outside:]]
        rows = [(next(j for j, entry in enumerate(row) if entry != 0), row) for row in self.linear_forms]
        for pivot, row in rows:
            if pivot >= n_outside + n_functions:
                X[pivot] = self._solve_form(row, pivot, X)
        values, _ = self.coordinates_and_rates(modular_point(self.equations, self._state(X)))
        X[n_outside : n_outside + n_functions] = values[n_outside : n_outside + n_functions]
        for pivot, row in rows:
            if pivot < n_outside:
                X[pivot] = self._solve_form(row, pivot, X)
            elif pivot < n_outside + n_functions and self._solve_form(row, pivot, X) != X[pivot]:
                raise _NotSampledError
        return modular_point(self.equations, self._state(X))

    def _solve_form(self, row: Vector, pivot: int, X: Vector) -> nmod:
        """Return the coordinate of the pivot for which the form vanishes."""
        remainder = sum((entry * (X[j] - self.start_coordinates[j]) for j, entry in enumerate(row) if j != pivot), nmod(0, PRIME))
        return self.start_coordinates[pivot] - remainder

    def _state(self, X: Vector) -> list[int]:
        values = [*X[: self.n_outside], *X[self.n_outside + self.functions.numel() :]]
        state = dict(zip(self.state_order, values, strict=True))
        return [int(state[i]) for i in range(self.equations.n)]

    def solution_series(self, seed: int) -> list[Vector]:
        """Return the coefficients t, t^2, ... of X along a solution from the state under random known inputs."""
        equations, arithmetic, n_terms = self.equations, self.start.arithmetic, len(self.start_coordinates) + 3
        inputs = [
            [as_residue(value) for value in random_residues(n_terms, f"{seed} along {i}")] for i in range(len(equations.known_fields))
        ]
        constants = [as_residue(value) for value in equations.values]
        states = equations.differential_flow.solution(
            arithmetic, FlowArguments([as_residue(v) for v in self.start.state], inputs, [], constants), n_terms - 1
        )
        series_cap = flint.ctx.cap
        flint.ctx.cap = n_terms
        try:
            function = equations.function(ca.densify(self.coordinates))
            values = evaluate(instructions(function), [[arithmetic.series(series) for series in states], constants], arithmetic)
        finally:
            flint.ctx.cap = series_cap
        columns = [([*arithmetic.coefficients(value), *[nmod(0, PRIME)] * n_terms])[:n_terms] for value in values]
        return [[column[k] for column in columns] for k in range(1, n_terms)]


def _smallest_invariant(chart: _Chart, seed: int) -> _Chart | None:
    """Return the smallest of the sets that is invariant. Raises _NotSampledError."""
    count = 2 if chart.equations.known_fields else 1
    chart = chart.extend_along([vector for k in range(count) for vector in chart.solution_series(seed + k)])
    for attempt in range(len(chart.start_coordinates) + 1):
        rates = [
            rate for k in range(_SAMPLES_PER_TEST) for rate in chart.coordinates_and_rates(chart.random_point(f"{seed} {attempt} {k}"))[1]
        ]
        larger = chart.extend_along(rates)
        if len(larger.directions) == len(chart.directions):
            return chart
        chart = larger
    return None
