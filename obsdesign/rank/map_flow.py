"""Outputs along one solution of a map from one instant to the next, with their sensitivities to its start and to unknown inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
from flint import arb_mat

from obsdesign.rank.graph import Arithmetic, Graph, Instruction, evaluate, graphs_of
from obsdesign.rank.taylor import FlowArguments


@dataclass(frozen=True, eq=False)
class MapFlow:
    """x_k+1 = next_state(x_k, u_k, w_k, constants), y_k = h(x_k, u_k, constants), all SX columns.

    Arguments hold u_k and w_k where those of a `Flow` hold coefficients of t^k.
    """

    x: ca.SX
    u: ca.SX
    w: ca.SX
    constants: ca.SX
    next_state: ca.SX
    h: ca.SX

    @cached_property
    def graphs(self) -> dict[str, Graph]:
        """Instructions of the map, of A = dF/dx, U = dF/du, B = dF/dw and C = dh/dx, with the sparsity of each."""
        expressions = {
            "F": ca.densify(self.next_state),
            "A": ca.jacobian(self.next_state, self.x),
            "U": ca.jacobian(self.next_state, self.u),
            "B": ca.jacobian(self.next_state, self.w),
            "C": ca.jacobian(self.h, self.x),
        }
        return graphs_of([self.x, self.u, self.w, self.constants], expressions)

    @property
    def steps(self) -> tuple[Instruction, ...]:
        """All instructions."""
        return tuple(step for _, steps in self.graphs.values() for step in steps)

    @cached_property
    def is_linear(self) -> bool:
        """Whether A, B and C are the same at all states and inputs."""
        variables = ca.vertcat(self.x, self.u, self.w)
        slopes = (ca.jacobian(self.next_state, ca.vertcat(self.x, self.w)), ca.jacobian(self.h, self.x))
        return not any(ca.depends_on(slope, variables) for slope in slopes)

    def sensitivities(self, arithmetic: Arithmetic, arguments: FlowArguments, orders: int, along: arb_mat | None = None) -> tuple[Any, ...]:
        """Return, for k = 0..orders, the matrix (q, p * orders + n) of d y_k / d (w_0, ..., w_(orders-1), x_0).

        along (p * orders + n, d): directions, where the derivatives along these are asked for, (q, d) each.
        X_k+1 = A_k X_k + (B_k in the columns of w_k), y_k = C_k X_k.
        """
        n, p = self.x.numel(), self.w.numel()
        zero, unit, width = arithmetic.number(0), arithmetic.number(1), p * orders + n
        X = arithmetic.matrix(n, width, [unit if j == p * orders + i else zero for i in range(n) for j in range(width)])
        X = X if along is None else X * along
        x, rows = list(arguments.x), []
        for k in range(orders + 1):
            at_step = self.at_step(x, arguments, k)
            rows.append(self.matrix("C", arithmetic, at_step) * X)
            if k == orders:
                break
            B = self.matrix("B", arithmetic, at_step).tolist() if p else []
            columns = [[*[zero] * (p * k), *B[i], *[zero] * (width - p * (k + 1))] if p else [zero] * width for i in range(n)]
            driven = arithmetic.matrix(n, width, [entry for row in columns for entry in row])
            X = self.matrix("A", arithmetic, at_step) * X + (driven if along is None else driven * along)
            x = evaluate(self.graphs["F"][1], at_step, arithmetic)
        return tuple(rows)

    responses = sensitivities

    @staticmethod
    def at_step(x: Sequence[Any], arguments: FlowArguments, k: int) -> list[Sequence[Any]]:
        """Return (x, u_k, w_k, constants)."""
        return [x, [series[k] for series in arguments.u], [series[k] for series in arguments.w], arguments.constants]

    def matrix(self, name: str, arithmetic: Arithmetic, at_step: Sequence[Sequence[Any]]) -> Any:  # noqa: ANN401  # of that arithmetic
        """Return one of the matrices at a step."""
        sparsity, steps = self.graphs[name]
        m, n = sparsity.shape
        entries = [arithmetic.number(0)] * (m * n)
        for value, i, j in zip(evaluate(steps, at_step, arithmetic), sparsity.row(), sparsity.get_col(), strict=True):
            entries[i * n + j] = value
        return arithmetic.matrix(m, n, entries)
