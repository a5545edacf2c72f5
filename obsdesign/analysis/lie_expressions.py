"""Lie derivatives as expressions, of which those are kept that tell something new: for the ranks step by step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import EvaluationPoint
from obsdesign.calculus import lie_derivative
from obsdesign.common_subexpressions import without_repeats
from obsdesign.rank.elimination import rank_at
from obsdesign.rank.residues import independent_rows, values_modulo

MAX_NODES = 20_000
"""Expressions of more nodes than this are not evaluated."""


class TooLargeError(Exception):
    """An expression has more than NODES nodes."""


class OtherBranchError(ZeroDivisionError):
    """Not as much is independent at a real place as modulo the prime: a root has the other sign, or functions are related."""


@dataclass(frozen=True, eq=False)
class IndependenceTest:
    """Functions of the state and where to evaluate them.

    At a place modulo the prime what is dependent is so by proof; at a real one what is independent.
    witness: a real place at which as much must be proven independent, and no more, as is modulo the prime.
    """

    equations: Equations
    point: EvaluationPoint
    witness: EvaluationPoint | None = None

    def independent_rows(self, matrix: ca.SX) -> tuple[int, ...]:
        """Return the first independent rows of the matrix at the place. Raises TooLargeError, NoValueError, OtherBranchError."""
        if ca.n_nodes(matrix) > 4 * MAX_NODES:
            raise TooLargeError
        (matrix,) = without_repeats([matrix])
        if ca.n_nodes(matrix) > MAX_NODES:
            raise TooLargeError
        function, arguments = self.equations.function(matrix), (self.point.state, self.equations.values)
        if self.point.is_modular:
            rows = independent_rows(values_modulo(function, arguments, self.point.arithmetic))
            if self.witness:
                self._require_same_rank(function, self.witness, len(rows))
            return rows
        rank = rank_at(function, arguments, range(matrix.shape[0]), confirm=False)
        return tuple(sorted(rank.rows))

    def _require_same_rank(self, matrix: ca.Function, witness: EvaluationPoint, rank: int) -> None:
        proven = rank_at(matrix, (witness.state, self.equations.values), confirm=False)
        if proven.rank != rank:
            raise OtherBranchError

    def independent_functions(self, functions: ca.SX) -> tuple[int, ...]:
        """Return the first of the functions (k, 1) whose gradients are independent; earlier ones are preferred."""
        return self.independent_rows(ca.jacobian(functions, self.equations.x))

    def vanishes(self, expression: ca.SX) -> bool:
        """Return whether every entry is 0 at the place."""
        column = ca.vec(expression)
        if column.nnz() == 0 or column.is_zero():
            return True
        return not self.independent_rows(ca.densify(column))

    def lie_derivatives(self, functions: ca.SX, fields: Sequence[ca.SX]) -> ca.SX:
        """Return the Lie derivatives of the functions along every field, without repetitions and constants."""
        if not fields or not functions.numel():
            return ca.SX(0, 1)
        derivatives = ca.vertcat(*(lie_derivative(functions, self.equations.x, field) for field in fields))
        if ca.n_nodes(derivatives) > 4 * MAX_NODES:
            raise TooLargeError
        (derivatives,) = without_repeats([derivatives])
        first = {derivatives[i].element_hash(): i for i in reversed(range(derivatives.numel()))}
        variable = set(ca.jacobian_sparsity(derivatives, self.equations.x).row())
        retained = sorted(variable & set(first.values()))
        return derivatives[retained] if retained else ca.SX(0, 1)


def sweep_ranks(independence: IndependenceTest, functions: ca.SX, fields: Sequence[ca.SX]) -> Iterator[int]:
    """Yield the rank after 0, 1, 2, ... sweeps of Lie derivatives of the functions along the fields, without end.

    A sweep derives only what the last one found: the rest adds nothing, the codistribution being a module over functions.
    """
    basis = functions[list(independence.independent_functions(functions))]
    latest = basis
    while True:
        yield basis.numel()
        candidates = independence.lie_derivatives(latest, fields)
        stacked = ca.vertcat(basis, candidates)
        independent = independence.independent_functions(stacked) if candidates.numel() else tuple(range(basis.numel()))
        latest = stacked[[i for i in independent if i >= basis.numel()]] if len(independent) > basis.numel() else ca.SX(0, 1)
        basis = ca.vertcat(basis, latest)
