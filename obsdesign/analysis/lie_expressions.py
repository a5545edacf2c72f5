"""Lie derivatives as expressions, of which those are kept that tell something new: for the ranks step by step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import Place
from obsdesign.calculus import lie_derivative
from obsdesign.common_subexpressions import without_repeats
from obsdesign.rank.elimination import rank_at
from obsdesign.rank.residues import independent_rows, values_modulo

NODES = 20_000
"""Expressions of more nodes than this are not evaluated."""


class TooLargeError(Exception):
    """An expression has more than NODES nodes."""


class OtherBranchError(ZeroDivisionError):
    """Not as much is independent at a real place as modulo the prime: a root has the other sign, or functions are related."""


@dataclass(frozen=True, eq=False)
class Space:
    """Functions of the state and where to evaluate them.

    At a place modulo the prime what is dependent is so by proof; at a real one what is independent.
    witness: a real place at which as much must be proven independent, and no more, as is modulo the prime.
    """

    equations: Equations
    place: Place
    witness: Place | None = None

    def independent(self, matrix: ca.SX) -> tuple[int, ...]:
        """Return the first independent rows of the matrix at the place. Raises TooLargeError, NoValueError, OtherBranchError."""
        if ca.n_nodes(matrix) > 4 * NODES:
            raise TooLargeError
        (matrix,) = without_repeats([matrix])
        if ca.n_nodes(matrix) > NODES:
            raise TooLargeError
        function, arguments = self.equations.function(matrix), (self.place.state, self.equations.values)
        if self.place.modular:
            chosen = independent_rows(values_modulo(function, arguments, self.place.arithmetic))
            if self.witness:
                self._require_as_much(function, self.witness, len(chosen))
            return chosen
        rank = rank_at(function, arguments, range(matrix.shape[0]), confirmed=False)
        return tuple(sorted(rank.rows))

    def _require_as_much(self, matrix: ca.Function, witness: Place, rank: int) -> None:
        shown = rank_at(matrix, (witness.state, self.equations.values), confirmed=False)
        if shown.rank != rank:
            raise OtherBranchError

    def telling(self, functions: ca.SX) -> tuple[int, ...]:
        """Return the first of the functions (k, 1) whose gradients are independent; earlier ones are preferred."""
        return self.independent(ca.jacobian(functions, self.equations.x))

    def vanishes(self, expression: ca.SX) -> bool:
        """Return whether every entry is 0 at the place."""
        column = ca.vec(expression)
        if column.nnz() == 0 or column.is_zero():
            return True
        return not self.independent(ca.densify(column))

    def derived(self, functions: ca.SX, fields: Sequence[ca.SX]) -> ca.SX:
        """Return the Lie derivatives of the functions along every field, without repetitions and constants."""
        if not fields or not functions.numel():
            return ca.SX(0, 1)
        every = ca.vertcat(*(lie_derivative(functions, self.equations.x, field) for field in fields))
        if ca.n_nodes(every) > 4 * NODES:
            raise TooLargeError
        (every,) = without_repeats([every])
        first = {every[i].element_hash(): i for i in reversed(range(every.numel()))}
        variable = set(ca.jacobian_sparsity(every, self.equations.x).row())
        chosen = sorted(variable & set(first.values()))
        return every[chosen] if chosen else ca.SX(0, 1)


def sweeps(space: Space, functions: ca.SX, fields: Sequence[ca.SX]) -> Iterator[int]:
    """Yield the rank after 0, 1, 2, ... sweeps of Lie derivatives of the functions along the fields, without end.

    A sweep derives only what the last one found: the rest adds nothing, the codistribution being a module over functions.
    """
    kept = functions[list(space.telling(functions))]
    latest = kept
    while True:
        yield kept.numel()
        found = space.derived(latest, fields)
        every = ca.vertcat(kept, found)
        chosen = space.telling(every) if found.numel() else tuple(range(kept.numel()))
        latest = every[[i for i in chosen if i >= kept.numel()]] if len(chosen) > kept.numel() else ca.SX(0, 1)
        kept = ca.vertcat(kept, latest)
