"""What experiments from one state tell about it: Taylor coefficients of the outputs, with free unknown inputs eliminated.

Let y_k (k = 0..K) be the Taylor coefficients of the outputs, w_k those of the unknown inputs, and J = [J_w J_x] the
Jacobian of (y_0, ..., y_K) with respect to (w_0, ..., w_(K-1), x(0)). Combinations of rows without a part in w tell about
the state alone: dimension = rank J - rank J_w. Known inputs are random polynomials in t: a generic smooth input
distinguishes all that any input does (Sontag 1979); several of them under one w stand for switching.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import flint
from flint import arb, arb_mat, nmod_mat

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import Place, random_fractions, random_residues
from obsdesign.rank.elimination import Bound, Rank, rank_of
from obsdesign.rank.exact_numbers import Number
from obsdesign.rank.graph import NoValueError
from obsdesign.rank.residues import bound_of
from obsdesign.rank.symbols import PRIME
from obsdesign.rank.taylor import Arguments


@dataclass(frozen=True, eq=False)
class Experiments:
    """Some experiments from one place: as many known inputs, one unknown input, Taylor coefficients up to `orders`.

    kept: rows that were computed, shared by what is made from these by `replace`.
    """

    equations: Equations
    place: Place
    orders: int
    count: int = 1
    seed: int = 0
    kept: dict[Any, Any] = field(default_factory=dict[Any, Any], repr=False)

    def _numbers(self, count: int, purpose: str) -> Sequence[Number]:
        draw = random_residues if self.place.modular else random_fractions
        return draw(count, f"{self.seed} {purpose}")

    def _inputs(self, count: int, purpose: str) -> list[Sequence[Number]]:
        # one sequence per input, whatever the orders: more orders continue the same input
        return [self._numbers(self.orders + 1, f"{purpose} {i}") for i in range(count)]

    @cached_property
    def labels(self) -> tuple[tuple[int, int, int], ...]:
        """For every row its (experiment, order, output)."""
        q = self.equations.outputs.numel()
        return tuple((c, k, i) for c in range(self.count) for k in range(self.orders + 1) for i in range(q))

    @property
    def row_orders(self) -> tuple[int, ...]:
        """For every row the order of its derivative."""
        return tuple(order for _, order, _ in self.labels)

    @property
    def width(self) -> int:
        """Number of columns of J."""
        return self.inputs + self.equations.n

    @property
    def inputs(self) -> int:
        """Number of columns of J_w, which come first."""
        return len(self.equations.unknown) * self.orders

    @property
    def eliminated(self) -> int:
        """Number of columns that come first and are no part of the state that is asked for."""
        return self.inputs + self.equations.extra

    def rows(self) -> list[list[Any]]:
        """Return J at the working precision, its rows by experiment, order, output."""
        return [row for experiment in range(self.count) for row in self._rows_of(experiment)]

    def _rows_of(self, experiment: int) -> list[list[Any]]:
        there = self.place.state if self.place.modular else (id(self.place), flint.ctx.prec)
        key = (id(self.equations), there, self.seed, self.orders, experiment)
        if key not in self.kept:
            self.kept[key] = (self.equations, self.place, self._computed(experiment))  # the first two to keep their ids theirs
        return self.kept[key][-1]

    def _computed(self, experiment: int) -> list[list[Any]]:
        equations = self.equations
        matrices = equations.flow.responses if self.place.modular else equations.flow.sensitivities
        return [row for matrix in matrices(self.place.arithmetic, self._arguments(experiment), self.orders) for row in matrix.tolist()]

    def along(self, directions: arb_mat) -> arb_mat:
        """Return J times directions (width, d) at a real place, at the working precision."""
        flow, arithmetic = self.equations.flow, self.place.arithmetic
        every = [flow.sensitivities(arithmetic, self._arguments(each), self.orders, directions) for each in range(self.count)]
        return arb_mat([row for matrices in every for matrix in matrices for row in matrix.tolist()])

    def _arguments(self, experiment: int) -> Arguments:
        equations, number = self.equations, self.place.arithmetic.number
        return Arguments(
            x=[number(value) for value in self.place.state],
            u=[[number(value) for value in series] for series in self._inputs(len(equations.known), f"known {experiment}")],
            w=[[number(value) for value in series] for series in self._inputs(len(equations.unknown), "unknown")],
            constants=[number(value) for value in equations.values],
        )

    def completed(self) -> Experiments:
        """Return as many experiments as it takes until more of them tell nothing more (modulo the prime)."""
        fewer = self
        while (more := replace(fewer, count=2 * fewer.count))._span > fewer._span:
            fewer = more
        return fewer

    @cached_property
    def _span(self) -> int:
        """Rank J."""
        return self._modular_rank(self.orders, slice(None))

    # ------------------------------------------------ modulo the prime

    @cached_property
    def _residues(self) -> list[list[Any]]:
        return self.rows()

    def _modular_rank(self, order: int, columns: slice) -> int:
        rows = [row[columns] for row, k in zip(self._residues, self.row_orders, strict=True) if k <= order]
        return nmod_mat(len(rows), len(rows[0]), [entry for row in rows for entry in row], PRIME).rank() if rows and rows[0] else 0

    def total(self, order: int) -> int:
        """Return rank J - rank of its part in w, added states included, with derivatives up to the order (modulo the prime)."""
        return self._modular_rank(order, slice(None)) - self._modular_rank(order, slice(self.inputs))

    def dimension(self, order: int) -> int:
        """Return rank J - rank of its eliminated part, with derivatives up to the order (modulo the prime)."""
        return self._modular_rank(order, slice(None)) - self._modular_rank(order, slice(self.eliminated))

    def bound(self, order: int, eliminated: int | None = None) -> Bound:
        """Return what the rank of what the rows up to the order tell about the state is at most (modulo the prime).

        eliminated: columns that come first and are not asked about (None: those of inputs and added states).
        """
        chosen = [row for row, k in zip(self._residues, self.row_orders, strict=True) if k <= order]
        return bound_of(chosen, self.width, self.eliminated if eliminated is None else eliminated)

    # ------------------------------------------------ in balls

    def rank(self, order: int, *, most: Bound | None = None, eliminated: int | None = None) -> Rank:
        """Return the rank of what the rows up to the order tell about the state that is asked for; most: what it is at most.

        eliminated: columns that come first and are not asked about (None: those of inputs and added states).
        """
        chosen = [i for i, k in enumerate(self.row_orders) if k <= order]
        eliminated = self.eliminated if eliminated is None else eliminated

        def rows() -> list[list[arb]]:
            every = self.rows()
            return [every[i] for i in chosen]

        stages = [self.row_orders[i] for i in chosen]
        try:
            return rank_of(rows, self.width - eliminated, eliminated, stages, precisions=self.place.precisions, confirmed=False, most=most)
        except NoValueError as error:
            _, order, output = self.labels[chosen[error.row]]
            what = f"the gradient of derivative {order} of output {self.equations.output_names[output]!r}"
            raise NoValueError(error.row, f"{what} at {self.equations.where(self.place)}") from None

    def reaches(self, order: int, most: Bound) -> bool:
        """Return whether the rows up to the order have the ranks that they have at most; most: bound(order, columns) elsewhere."""
        bare = replace(most, seen=None)
        columns = self.width - len(most.seen or ())
        return self.rank(order, most=bare, eliminated=columns).decided
