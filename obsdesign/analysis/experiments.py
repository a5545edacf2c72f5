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
from flint import arb, arb_mat

from obsdesign.analysis.equations import Equations
from obsdesign.analysis.evaluation_point import EvaluationPoint, random_fractions, random_residues
from obsdesign.rank.elimination import Rank, RankBound, rank_of
from obsdesign.rank.exact_numbers import Number
from obsdesign.rank.graph import NoValueError
from obsdesign.rank.residues import modular_rank, rank_bound
from obsdesign.rank.taylor import FlowArguments


@dataclass(frozen=True, eq=False)
class Experiments:
    """Some experiments from one place: as many known inputs, one unknown input, Taylor coefficients up to `orders`.

    row_cache: rows that were computed, shared by what is made from these by `replace`.
    """

    equations: Equations
    point: EvaluationPoint
    orders: int
    count: int = 1
    seed: int = 0
    row_cache: dict[Any, Any] = field(default_factory=dict[Any, Any], repr=False)

    def _random_numbers(self, count: int, purpose: str) -> Sequence[Number]:
        draw = random_residues if self.point.is_modular else random_fractions
        return draw(count, f"{self.seed} {purpose}")

    def _random_inputs(self, count: int, purpose: str) -> list[Sequence[Number]]:
        # one sequence per input, whatever the orders: more orders continue the same input
        return [self._random_numbers(self.orders + 1, f"{purpose} {i}") for i in range(count)]

    @cached_property
    def row_labels(self) -> tuple[tuple[int, int, int], ...]:
        """For every row its (experiment, order, output)."""
        q = self.equations.outputs.numel()
        return tuple((c, k, i) for c in range(self.count) for k in range(self.orders + 1) for i in range(q))

    @property
    def row_orders(self) -> tuple[int, ...]:
        """For every row the order of its derivative."""
        return tuple(order for _, order, _ in self.row_labels)

    @property
    def n_columns(self) -> int:
        """Number of columns of J."""
        return self.n_input_columns + self.equations.n

    @property
    def n_input_columns(self) -> int:
        """Number of columns of J_w, which come first."""
        return len(self.equations.unknown_fields) * self.orders

    @property
    def n_eliminated(self) -> int:
        """Number of columns that come first and are no part of the state that is asked for."""
        return self.n_input_columns + self.equations.n_added

    def rows(self) -> list[list[Any]]:
        """Return J at the working precision, its rows by experiment, order, output."""
        return [row for experiment in range(self.count) for row in self._experiment_rows(experiment)]

    def _experiment_rows(self, experiment: int) -> list[list[Any]]:
        point_key = self.point.state if self.point.is_modular else (id(self.point), flint.ctx.prec)
        key = (id(self.equations), point_key, self.seed, self.orders, experiment)
        if key not in self.row_cache:
            self.row_cache[key] = (self.equations, self.point, self._compute_rows(experiment))  # the first two to keep their ids theirs
        return self.row_cache[key][-1]

    def _compute_rows(self, experiment: int) -> list[list[Any]]:
        equations = self.equations
        matrices = equations.flow.responses if self.point.is_modular else equations.flow.sensitivities
        return [row for matrix in matrices(self.point.arithmetic, self.arguments(experiment), self.orders) for row in matrix.tolist()]

    def along(self, directions: arb_mat) -> arb_mat:
        """Return J times directions (width, d) at a real place, at the working precision."""
        flow, arithmetic = self.equations.flow, self.point.arithmetic
        every = [flow.sensitivities(arithmetic, self.arguments(experiment), self.orders, directions) for experiment in range(self.count)]
        return arb_mat([row for matrices in every for matrix in matrices for row in matrix.tolist()])

    def arguments(self, experiment: int) -> FlowArguments:
        """Return where the flow of one of the experiments is followed."""
        equations, number = self.equations, self.point.arithmetic.number
        return FlowArguments(
            x=[number(value) for value in self.point.state],
            u=[[number(value) for value in series] for series in self._random_inputs(len(equations.known_fields), f"known {experiment}")],
            w=[[number(value) for value in series] for series in self._random_inputs(len(equations.unknown_fields), "unknown")],
            constants=[number(value) for value in equations.values],
        )

    def complete(self) -> Experiments:
        """Return as many experiments as it takes until more of them tell nothing more (modulo the prime)."""
        experiments = self
        while (doubled := replace(experiments, count=2 * experiments.count))._jacobian_rank > experiments._jacobian_rank:
            experiments = doubled
        return experiments

    @cached_property
    def _jacobian_rank(self) -> int:
        """Rank J."""
        return self._modular_rank(self.orders, slice(None))

    # ------------------------------------------------ modulo the prime

    @cached_property
    def _modular_rows(self) -> list[list[Any]]:
        return self.rows()

    def _modular_rank(self, order: int, columns: slice) -> int:
        rows = [row[columns] for row, k in zip(self._modular_rows, self.row_orders, strict=True) if k <= order]
        return modular_rank(rows)

    def total_dimension(self, order: int) -> int:
        """Return rank J - rank of its part in w, added states included, with derivatives up to the order (modulo the prime)."""
        return self._modular_rank(order, slice(None)) - self._modular_rank(order, slice(self.n_input_columns))

    def dimension(self, order: int) -> int:
        """Return rank J - rank of its eliminated part, with derivatives up to the order (modulo the prime)."""
        return self._modular_rank(order, slice(None)) - self._modular_rank(order, slice(self.n_eliminated))

    def bound(self, order: int, n_eliminated: int | None = None) -> RankBound:
        """Return what the rank of what the rows up to the order tell about the state is at most (modulo the prime).

        n_eliminated: columns that come first and are not asked about (None: those of inputs and added states).
        """
        rows = [row for row, k in zip(self._modular_rows, self.row_orders, strict=True) if k <= order]
        n_eliminated = self.n_eliminated if n_eliminated is None else n_eliminated
        bound = rank_bound(rows, self.n_columns, n_eliminated)
        known = self._start_rows()
        return replace(bound, with_start=rank_bound([*rows, *known], self.n_columns, n_eliminated)) if known else bound

    # ------------------------------------------------ in balls

    def rank(self, order: int, *, upper_bound: RankBound | None = None, n_eliminated: int | None = None) -> Rank:
        """Return the rank of what the rows up to the order tell about the state that is asked for; upper_bound: what it is at most.

        n_eliminated: columns that come first and are not asked about (None: those of inputs and added states).
        """
        n_eliminated = self.n_eliminated if n_eliminated is None else n_eliminated
        rank = self._rank_up_to(order, n_eliminated, confirm=False, upper_bound=upper_bound)
        if not upper_bound or not upper_bound.with_start:
            return rank
        bound = upper_bound.with_start
        return replace(rank, with_start=self._rank_up_to(order, n_eliminated, with_start=True, confirm=False, upper_bound=bound))

    def numerical_rank(self, order: int) -> Rank:
        """Return the rank as far as it can be told from numbers: what is thin around 0 at many bits counts as 0."""
        rank = self._rank_up_to(order, self.n_eliminated)
        if not self.equations.known_at_start:
            return rank
        return replace(rank, with_start=self._rank_up_to(order, self.n_eliminated, with_start=True))

    def _rank_up_to(
        self, order: int, n_eliminated: int, *, with_start: bool = False, confirm: bool = True, upper_bound: RankBound | None = None
    ) -> Rank:
        """Return the rank of the rows of the derivatives up to an order; with_start: and of what is known at the start."""
        indices = [i for i, k in enumerate(self.row_orders) if k <= order]
        stages = [self.row_orders[i] for i in indices] + [order + 1] * (len(self.equations.known_at_start) if with_start else 0)

        def rows() -> list[list[arb]]:
            """Return the rows at the working precision."""
            every = self.rows()
            return [*(every[i] for i in indices), *(self._start_rows() if with_start else ())]

        n, precisions = self.n_columns - n_eliminated, self.point.precisions
        try:
            return rank_of(rows, n, n_eliminated, stages, confirm=confirm, precisions=precisions, upper_bound=upper_bound)
        except NoValueError as error:
            _, order, output = self.row_labels[indices[error.row]]
            what = f"the gradient of derivative {order} of output {self.equations.output_names[output]!r}"
            raise NoValueError(error.row, f"{what} at {self.equations.describe(self.point)}") from None

    def _start_rows(self) -> list[list[Any]]:
        """Return the unit rows of the states that are known at the start."""
        number, first = self.point.arithmetic.number, self.n_columns - self.equations.n_queried
        return [[number(int(j == first + i)) for j in range(self.n_columns)] for i in self.equations.known_at_start]

    def reaches(self, order: int, upper_bound: RankBound) -> bool:
        """Return whether the rows up to the order have the ranks that they have at most; upper_bound: bound(order, columns) elsewhere."""
        total_bound = replace(upper_bound, is_determined=None)
        columns = self.n_columns - len(upper_bound.is_determined or ())
        return self.rank(order, upper_bound=total_bound, n_eliminated=columns).is_decided
