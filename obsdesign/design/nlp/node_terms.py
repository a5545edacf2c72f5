"""What of a program stands at single nodes: limits, budgets and prices, with first and second derivatives."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from obsdesign.design.nlp.constraint_rows import evaluate_rows
from obsdesign.design.nlp.evaluation import ConstraintRows, Evaluation
from obsdesign.design.nlp.margin_curves import MarginCurves, margin_curves_of
from obsdesign.design.nlp.node_functions import NodeFunctions, node_functions_of
from obsdesign.design.nlp.rollout import NodeCosts, Rollout
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.evaluation import Multipliers


class NodeTerms:
    """Rows of limits, then 1 - cost / at_most of every budget, and the price of a path. Nothing changes after construction."""

    def __init__(self, problem: DesignProblem, rows: ConstraintRows) -> None:
        model, pace = problem.system.model, (problem.step, problem.substeps)
        self._problem, self._rows, self._steps = problem, rows, problem.steps
        self._n, self._m = len(model.states), len(model.inputs)
        costs = tuple(term.cost for term in (*problem.prices, *problem.budgets))
        self._functions: NodeFunctions | None = (
            node_functions_of(model, problem.constraints, costs, pace) if problem.constraints or costs else None
        )
        self._most = np.array([budget.at_most for budget in problem.budgets])
        self._price_rates = np.array([price.per_unit for price in problem.prices])

    def evaluate(self, rollout: Rollout) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
        """Return the rows (r,), the price, and nodes and delays [s] of the limits' rows."""
        margins, totals = self.values(rollout)
        price = float(self._price_rates @ totals[: len(self._price_rates)])
        budgets = 1 - totals[len(self._price_rates) :] / self._most
        row_values = evaluate_rows(self._problem, self._rows, rollout.z[0, :, : self._n], rollout.u[0], margins)
        return np.concatenate([row_values.values - self._rows.allowance, budgets]), price, row_values.node, row_values.delay

    @cached_property
    def _margin_curves(self) -> MarginCurves:
        return margin_curves_of(self._problem.system.model, self._problem.constraints)

    def values(self, rollout: Rollout) -> tuple[np.ndarray, np.ndarray]:
        """Return the margins (N+1, r) at the nodes, and the sums of the costs."""
        if self._functions is None:
            return np.zeros((self._steps + 1, 0)), np.zeros(0)
        values = self._functions.values(*self._variables(rollout))
        margin_count = self._functions.margin_count
        return values[:, :margin_count], values[:-1, margin_count:].sum(axis=0) * self._problem.step

    def _variables(self, rollout: Rollout) -> tuple[np.ndarray, np.ndarray]:
        """(x, u) at all nodes of the path itself; the last inputs count for the end as well."""
        return rollout.z[0, :, : self._n], np.vstack([rollout.u[0], rollout.u[0, -1:]])

    def derivatives(self, evaluation: Evaluation, G: np.ndarray, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of the rows and budgets (r, q), and of the price (q,)."""
        if self._functions is None:
            return np.zeros((0, M.shape[-1])), np.zeros(M.shape[-1])
        x, u = self._variables(evaluation.rollout)
        gradients = self._functions.gradients(x, u)
        margin_count, n = self._functions.margin_count, self._n
        node_inputs = np.vstack([M, M[-1:]])
        node, margin = evaluation.node, self._rows.margin
        at_rows = gradients[node, margin]
        between = np.flatnonzero(evaluation.delay > 0)
        if between.size:
            k = node[between]
            at_rows[between] = self._margin_curves.gradients(x[k], u[k], evaluation.delay[between])[np.arange(len(k)), margin[between]]
        rows = np.zeros((len(node), M.shape[-1]))
        for i in np.flatnonzero(at_rows.any(axis=0)):  # limits depend on few of the variables
            rows += at_rows[:, i, None] * (G[0, node, i] if i < n else node_inputs[node, i - n])
        cut, costs = len(self._price_rates), gradients[:-1, margin_count:]
        if not costs.shape[1]:
            return rows, np.zeros(M.shape[-1])
        totals = self._problem.step * (
            np.einsum("krn,knq->rq", costs[:, :, :n], G[0, :-1, :n]) + np.einsum("krm,kmq->rq", costs[:, :, n:], M)
        )
        return np.vstack([rows, -totals[cut:] / self._most[:, None]]), self._price_rates @ totals[:cut]

    def lagrangian(self, evaluation: Evaluation, multipliers: Multipliers) -> NodeCosts:
        """Return what of the Lagrangian depends on single nodes: its gradient and Hessian to (x, u) there."""
        runs, v = len(evaluation.rollout.z), self._n + self._m
        g, H = np.zeros((runs, self._steps + 1, v)), np.zeros((runs, self._steps + 1, v, v))
        if self._functions is not None:
            margin_count, rows = self._functions.margin_count, len(self._rows.node)
            weights, at_node = np.zeros((self._steps + 1, len(self._functions.owner))), evaluation.delay == 0
            np.add.at(weights, (evaluation.node[at_node], self._rows.margin[at_node]), -multipliers.rows[:rows][at_node])
            budgets = multipliers.rows[rows : rows + len(self._most)]
            weights[:-1, margin_count:] = self._problem.step * np.concatenate([multipliers.price * self._price_rates, budgets / self._most])
            involved = np.flatnonzero(weights.any(axis=1))
            if involved.size:
                x, u = self._variables(evaluation.rollout)
                g[0, involved], H[0, involved] = self._functions.hessians(x[involved], u[involved], weights[involved])
            self._add_between_nodes(evaluation, multipliers, g[0], H[0])
        return NodeCosts(g, H)

    def _add_between_nodes(self, evaluation: Evaluation, multipliers: Multipliers, g: np.ndarray, H: np.ndarray) -> None:
        """Add to g (N+1, v) and H (N+1, v, v) what rows between the nodes bend."""
        between = np.flatnonzero((evaluation.delay > 0) & (multipliers.rows[: len(evaluation.delay)] != 0))
        if between.size:
            (x, u), k = self._variables(evaluation.rollout), evaluation.node[between]
            weights = np.zeros((len(between), self._functions.margin_count if self._functions else 0))
            weights[np.arange(len(between)), self._rows.margin[between]] = -multipliers.rows[between]
            gradient, hessian = self._margin_curves.hessians(x[k], u[k], evaluation.delay[between], weights)
            np.add.at(g, k, gradient)
            np.add.at(H, k, hessian)
            is_choice = np.isin(between, [row for choice in self._rows.choices for row in choice.rows])
            if is_choice.any():
                choice_hessians = self._margin_curves.best_instant_hessians(
                    x[k[is_choice]], u[k[is_choice]], evaluation.delay[between[is_choice]]
                )
                np.add.at(H, k[is_choice], np.einsum("kr,krvw->kvw", weights[is_choice], choice_hessians))
