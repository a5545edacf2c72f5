"""Lie derivatives as expressions, of which those are kept that tell something new: for the ranks step by step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.places import Place
from obsdesign.calculus import lie_derivative
from obsdesign.rank.elimination import rank_at
from obsdesign.rank.residues import independent_rows, values_modulo

NODES = 20_000
"""Expressions of more nodes than this are not evaluated."""


class TooLargeError(Exception):
    """An expression has more than NODES nodes."""


class Rows(NamedTuple):
    """The first independent rows of a matrix at a place, by index; not decided where the precision limit was reached."""

    chosen: tuple[int, ...]
    decided: bool


@dataclass(frozen=True, eq=False)
class Space:
    """Functions of the state and where to evaluate them; confirmed: what counts as 0 is confirmed at a high precision."""

    equations: Equations
    place: Place
    confirmed: bool = True

    def independent(self, matrix: ca.SX, stages: Sequence[int] | None = None) -> Rows:
        """Return independent rows of the matrix at the place, those of a lower stage first. Raises TooLargeError, NoValueError."""
        if ca.n_nodes(matrix) > 4 * NODES:
            raise TooLargeError
        matrix = ca.cse(matrix)
        if ca.n_nodes(matrix) > NODES:
            raise TooLargeError
        function = self.equations.function(matrix)
        if self.place.modular:
            values = values_modulo(function, (self.place.state, self.equations.values))
            order = sorted(range(len(values)), key=lambda i: stages[i] if stages else 0)
            chosen = independent_rows([values[i] for i in order])
            return Rows(tuple(sorted(order[i] for i in chosen)), True)
        rank = rank_at(function, (self.place.state, self.equations.values), stages or range(matrix.shape[0]), confirmed=self.confirmed)
        return Rows(tuple(sorted(rank.rows)), rank.decided or rank.rank == matrix.shape[1])

    def telling(self, functions: ca.SX) -> Rows:
        """Return the first of the functions (k, 1) whose gradients are independent; earlier ones are preferred."""
        return self.independent(ca.jacobian(functions, self.equations.x))

    def vanishes(self, expression: ca.SX) -> bool:
        """Return whether every entry is 0 at the place."""
        column = ca.vec(expression)
        if column.nnz() == 0 or column.is_zero():
            return True
        return not self.independent(ca.densify(column)).chosen

    def derived(self, functions: ca.SX, fields: Sequence[ca.SX]) -> ca.SX:
        """Return the Lie derivatives of the functions along every field, without repetitions and constants."""
        if not fields or not functions.numel():
            return ca.SX(0, 1)
        every = ca.vertcat(*(lie_derivative(functions, self.equations.x, field) for field in fields))
        if ca.n_nodes(every) > 4 * NODES:
            raise TooLargeError
        every = ca.cse(every)
        first = {every[i].element_hash(): i for i in reversed(range(every.numel()))}
        variable = set(ca.jacobian_sparsity(every, self.equations.x).row())
        chosen = sorted(variable & set(first.values()))
        return every[chosen] if chosen else ca.SX(0, 1)


def sweeps(space: Space, functions: ca.SX, fields: Sequence[ca.SX]) -> Iterator[int]:
    """Yield the rank after 0, 1, 2, ... sweeps of Lie derivatives of the functions along the fields, without end.

    A sweep derives only what the last one found: the rest adds nothing, the codistribution being a module over functions.
    """
    kept = functions[list(space.telling(functions).chosen)]
    latest = kept
    while True:
        yield kept.numel()
        found = space.derived(latest, fields)
        every = ca.vertcat(kept, found)
        chosen = space.telling(every).chosen if found.numel() else tuple(range(kept.numel()))
        latest = every[[i for i in chosen if i >= kept.numel()]] if len(chosen) > kept.numel() else ca.SX(0, 1)
        kept = ca.vertcat(kept, latest)
