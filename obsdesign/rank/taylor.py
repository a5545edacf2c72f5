"""Taylor coefficients of the outputs along one solution, with their sensitivities: no Lie derivative, no growing graph.

Source: A. Sedoglavic, "A probabilistic algorithm to test local algebraic observability in polynomial time", 2002.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import flint
from flint import arb_mat

from obsdesign.rank.graph import Arithmetic, Graph, Instruction, evaluate, graphs_of

Series = list[Any]  # coefficients of t^0, t^1, ...


@dataclass(frozen=True, eq=False)
class Flow:
    """xdot = rate(x, u, w, constants), y = h(x, constants), all SX columns; w enters linearly."""

    x: ca.SX
    u: ca.SX
    w: ca.SX
    constants: ca.SX
    rate: ca.SX
    h: ca.SX

    @cached_property
    def graphs(self) -> dict[str, Graph]:
        """Instructions of the rate, of A = d rate/dx, B = d rate/dw and C = dh/dx, each with its sparsity."""
        expressions = {
            "rate": ca.densify(self.rate),
            "A": ca.jacobian(self.rate, self.x),
            "B": ca.jacobian(self.rate, self.w),
            "C": ca.jacobian(self.h, self.x),
        }
        return graphs_of([self.x, self.u, self.w, self.constants], expressions)

    @property
    def steps(self) -> tuple[Instruction, ...]:
        """All instructions."""
        return tuple(step for _, steps in self.graphs.values() for step in steps)

    def solution(self, arithmetic: Arithmetic, arguments: FlowArguments, orders: int) -> list[Series]:
        """Return the coefficients t^0..t^orders of x (n,): x(0) + int rate dt, one order more with every pass."""
        states = [[value] for value in arguments.x]
        for n_known in range(1, orders + 1):
            rates = self._series("rate", arithmetic, arguments, states, n_known)
            states = [[start, *(rate[k] / (k + 1) for k in range(n_known))] for start, rate in zip(arguments.x, rates, strict=True)]
        return states

    def sensitivities(self, arithmetic: Arithmetic, arguments: FlowArguments, orders: int, along: arb_mat | None = None) -> tuple[Any, ...]:
        """Return, for k = 0..orders, the matrix (q, p * orders + n) of d y_k / d (w_0, ..., w_(orders-1), x(0)).

        along (p * orders + n, d): directions, where the derivatives along these are asked for, (q, d) each.

        y_k, w_k: coefficients of t^k. X_(k+1) = (sum_j A_j X_(k-j) + B_(k-l) in the columns of w_l) / (k + 1), y_k = sum_j C_j X_(k-j).
        """
        n, p = self.x.numel(), self.w.numel()
        states = self.solution(arithmetic, arguments, orders)
        A, B, C = (self._matrices(name, arithmetic, arguments, states, orders + 1) for name in ("A", "B", "C"))
        zero = arithmetic.number(0)
        unit = arithmetic.number(1)
        n_columns = p * orders + n
        start = arithmetic.matrix(n, n_columns, [unit if j == p * orders + i else zero for i in range(n) for j in range(n_columns)])
        X = [start if along is None else start * along]
        for k in range(orders):
            input_terms = [B[k - order][i, j] if order <= k else zero for i in range(n) for order in range(orders) for j in range(p)]
            columns = [input_terms[i * p * orders : (i + 1) * p * orders] + [zero] * n for i in range(n)]
            total = arithmetic.matrix(n, n_columns, [entry for row in columns for entry in row])
            total = total if along is None else total * along
            for j in range(k + 1):
                total = total + A[j] * X[k - j]
            X.append(total * (unit / (k + 1)))
        return tuple(sum((C[j] * X[k - j] for j in range(1, k + 1)), C[0] * X[k]) for k in range(orders + 1))

    def responses(self, arithmetic: Arithmetic, arguments: FlowArguments, orders: int) -> tuple[Any, ...]:
        """Return the same as `sensitivities`, with less work for many orders, modulo the prime: in balls it loses more to rounding.

        With Phi' = A Phi and Psi' = -Psi A, both I at t = 0, G = C Phi and H = Psi B, dy(t) = G(t) (dx(0) + int_0^t H(s) dw(s) ds): so
        d y_k / d w_l = sum_m G_(s-m) H_m / (m + l + 1) with s = k - l - 1.
        """
        states = self.solution(arithmetic, arguments, orders)
        A, B, C = (self._matrices(name, arithmetic, arguments, states, orders + 1) for name in ("A", "B", "C"))
        Phi = _integrate(arithmetic, orders, self.x.numel(), lambda j, X: A[j] * X)
        G = [sum((C[j] * Phi[k - j] for j in range(1, k + 1)), C[0] * Phi[k]) for k in range(orders + 1)]
        if not self.w.numel() or not orders:
            return tuple(G)
        Psi = _integrate(arithmetic, orders - 1, self.x.numel(), lambda j, X: -(X * A[j]))
        H = [sum((Psi[k - j] * B[j] for j in range(1, k + 1)), Psi[k] * B[0]) for k in range(orders)]
        return _input_responses(arithmetic, G, H)

    def _series(self, name: str, arithmetic: Arithmetic, arguments: FlowArguments, states: list[Series], n_terms: int) -> list[Series]:
        """Return the first coefficients of the nonzeros of a graph along the solution."""
        series_cap = flint.ctx.cap
        flint.ctx.cap = n_terms
        try:
            inputs = [[arithmetic.series(series[:n_terms]) for series in group] for group in (states, arguments.u, arguments.w)]
            values = evaluate(self.graphs[name][1], [*inputs, arguments.constants], arithmetic)
        finally:
            flint.ctx.cap = series_cap
        zero = arithmetic.number(0)
        return [([*arithmetic.coefficients(value), *[zero] * n_terms])[:n_terms] for value in values]

    def _matrices(self, name: str, arithmetic: Arithmetic, arguments: FlowArguments, states: list[Series], n_terms: int) -> list[Any]:
        sparsity, _ = self.graphs[name]
        m, n = sparsity.shape
        entries = [[arithmetic.number(0)] * (m * n) for _ in range(n_terms)]
        for series, i, j in zip(
            self._series(name, arithmetic, arguments, states, n_terms), sparsity.row(), sparsity.get_col(), strict=True
        ):
            for k in range(n_terms):
                entries[k][i * n + j] = series[k]
        return [arithmetic.matrix(m, n, matrix_entries) for matrix_entries in entries]


def _integrate(arithmetic: Arithmetic, orders: int, n: int, product: Callable[[int, Any], Any]) -> list[Any]:
    """Return the coefficients t^0..t^orders of X (n, n) with X' = sum_j t^j product(j, X), X = I at t = 0."""
    zero, unit = arithmetic.number(0), arithmetic.number(1)
    X = [arithmetic.matrix(n, n, [unit if i == j else zero for i in range(n) for j in range(n)])]
    for k in range(orders):
        total = product(0, X[k])
        for j in range(1, k + 1):
            total = total + product(j, X[k - j])
        X.append(total * (unit / (k + 1)))
    return X


def _input_responses(arithmetic: Arithmetic, G: list[Any], H: list[Any]) -> tuple[Any, ...]:
    """Return the matrices (q, p * orders + n) of d y_k / d (w_0, ..., w_(orders-1), x(0)) from G (q, n) and H (n, p).

    For each s = k - l - 1 and pair of output and input the sums over m are the coefficients of a product of two polynomials.
    """
    orders, q, n, p = len(H), G[0].nrows(), G[0].ncols(), H[0].ncols()
    zero, unit = arithmetic.number(0), arithmetic.number(1)
    rows = [row for matrix in G for row in matrix.tolist()]
    columns = [[entry for coefficient in H for entry in coefficient.tolist()[i]] for i in range(n)]
    G_matrix = arithmetic.matrix(len(rows), n, [entry for row in rows for entry in row])
    H_matrix = arithmetic.matrix(n, p * orders, [entry for row in columns for entry in row])
    products = (G_matrix * H_matrix).tolist()  # (order of G, output), (order of H, input)
    weights = arithmetic.series([unit / m for m in range(1, orders + 1)])
    responses = [[[zero] * (p * orders) for _ in range(q)] for _ in range(orders + 1)]
    for s in range(orders):
        for i in range(q):
            for j in range(p):
                terms = arithmetic.series([products[m * q + i][(s - m) * p + j] for m in range(s + 1)])  # the highest m first
                sums = (terms * weights).coeffs()
                for order, value in enumerate(sums[s:orders]):
                    responses[s + order + 1][i][order * p + j] = value
    return tuple(
        arithmetic.matrix(q, p * orders + n, [entry for i in range(q) for entry in (*responses[k][i], *rows[k * q + i])])
        for k in range(orders + 1)
    )


@dataclass(frozen=True)
class FlowArguments:
    """Where a flow is followed, in ring elements: x(0) (n,), the coefficients of each u and each w, the constants."""

    x: Sequence[Any]
    u: Sequence[Series]
    w: Sequence[Series]
    constants: Sequence[Any]
