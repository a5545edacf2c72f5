"""Where a path breaks what is asked of it: at its nodes and between them, by how much, in units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.design.between_nodes import fine_path
from obsdesign.design.nlp.constraint_rows import initial_rows, node_margins, nodes_between, tighten, time_window
from obsdesign.design.nlp.node_functions import node_functions_of
from obsdesign.design.path_costs import total_costs
from obsdesign.design.problem import DesignProblem
from obsdesign.design.violation import InputBound, InputRate, Violation, ViolationKind
from obsdesign.dynamics.model import Model
from obsdesign.information.windows import sliding_information
from obsdesign.trajectory import Trajectory

# rows are part of what this module is asked for
__all__ = (
    "MARGIN_TOLERANCE",
    "LeastMargin",
    "fine_path",
    "initial_rows",
    "is_feasible",
    "least_margins_at_nodes",
    "node_margins",
    "nodes_within",
    "tighten",
    "violations",
)

MARGIN_TOLERANCE = 1e-6  # by how much a margin, of order 1, may fall short


@dataclass(frozen=True)
class LeastMargin:
    """Where a constraint is nearest to being broken, or broken most."""

    constraint: AbstractConstraint
    """The constraint."""
    time: float
    """When that is [s]."""
    value: float
    """The margin there, of order 1; < 0 where it is broken, inf where the constraint limits nothing."""

    def violation(self, kind: ViolationKind = ViolationKind.CONSTRAINT) -> Violation:
        """Return the same as something that a path breaks."""
        size, unit = self.constraint.size
        return Violation(self.constraint, kind, self.time, float(-self.value * size), unit, self.value)


def nodes_within(constraint: AbstractConstraint, steps: int, step: float) -> np.ndarray:
    """Return the nodes of a grid of N steps that lie within a constraint's span, the nearest one at least."""
    first, last = time_window(constraint, steps * step)
    inside = nodes_between(first, last, steps, step)
    return inside if inside.size else np.array([min(steps, round(first / step))])


def violations(problem: DesignProblem, path: Trajectory) -> tuple[Violation, ...]:
    """Return every limit that a path breaks, each where it does so most, worst first: constraints, bounds, rates, budgets, floors."""
    all_violations = [
        *_constraint_violations(problem, path),
        *_input_violations(problem, path),
        *_rate_violations(problem, path),
        *_budget_violations(problem, path),
        *_floor_violations(problem, path),
    ]
    return tuple(sorted(all_violations, key=lambda violation: violation.margin))


def is_feasible(problem: DesignProblem, path: Trajectory) -> bool:
    """Whether a path breaks no limit."""
    return not violations(problem, path)


def least_margins_at_nodes(
    model: Model, constraints: tuple[AbstractConstraint, ...], x: np.ndarray, u: np.ndarray, step: float
) -> tuple[LeastMargin, ...]:
    """Return where each constraint is nearest to being broken at the nodes x (N+1, n) of its span, inputs u (N, m) held between them."""
    if not constraints:
        return ()
    functions = node_functions_of(model, constraints)
    values = functions.least(functions.values(x, np.vstack([u, u[-1:]])))
    least = []
    for i, constraint in enumerate(constraints):
        within = nodes_within(constraint, len(u), step)
        inside = values[within, i]
        k = int(within[inside.argmax() if constraint.span.anywhere else inside.argmin()])
        least.append(LeastMargin(constraint, k * step, float(values[k, i])))
    return tuple(least)


@np.errstate(invalid="ignore", over="ignore")  # a path may be absurd: what is no number is no margin
def _constraint_violations(problem: DesignProblem, path: Trajectory) -> list[Violation]:
    if not node_functions_of(problem.system.model, problem.constraints).owner:  # limits may limit nothing
        return []
    fine, broken = fine_path(problem, path), []
    for i, constraint in enumerate(problem.constraints):
        minima = fine.minima_of(i, constraint.span)
        if minima and not minima[0].value >= -MARGIN_TOLERANCE:
            broken.append(LeastMargin(constraint, minima[0].time, minima[0].value).violation())
    return broken


def _input_violations(problem: DesignProblem, path: Trajectory) -> list[Violation]:
    broken = []
    for j, signal in enumerate(problem.system.model.inputs):
        u, width = path.u[:, j], problem.upper[j] - problem.lower[j]
        excess = np.maximum(u - problem.upper[j], problem.lower[j] - u)
        k = int(excess.argmax())
        if excess[k] > MARGIN_TOLERANCE * width:
            bound, time = InputBound(signal, float(problem.lower[j]), float(problem.upper[j])), float(path.t[k])
            broken.append(Violation(bound, ViolationKind.INPUT_BOUND, time, float(excess[k]), signal.unit, float(-excess[k] / width)))
    return broken


def _rate_violations(problem: DesignProblem, path: Trajectory) -> list[Violation]:
    """Rates of change: those between neighbouring steps, or those of the family where the inputs are of it and these are less."""
    broken, step_rates = [], np.abs(np.diff(path.u, axis=0)) / path.step
    limits = np.array([problem.rates.get(signal.name, np.inf) for signal in problem.system.model.inputs])
    if not (step_rates > limits * (1 + MARGIN_TOLERANCE)).any():
        return []
    of_family = _family_rates(problem, path.u)
    for j in np.flatnonzero(np.minimum(step_rates.max(axis=0), of_family) > limits * (1 + MARGIN_TOLERANCE)):
        limit, k = InputRate(problem.system.model.inputs[j], float(limits[j])), int(step_rates[:, j].argmax())
        rate, time = float(min(step_rates[k, j], of_family[j])), float(path.t[k + 1])
        margin = float(1 - rate / limit.at_most)
        broken.append(Violation(limit, ViolationKind.INPUT_RATE, time, float(rate - limit.at_most), limit.unit, margin))
    return broken


def _family_rates(problem: DesignProblem, u: np.ndarray) -> np.ndarray:
    """The largest rate of change of each input (m,) by the problem's family, inf where u (N, m) is none of it."""
    grid, unbounded = problem.grid, np.full(u.shape[1], np.inf)
    if len(u) != grid.steps:
        return unbounded
    p = problem.path.fit(u, grid)
    if not (np.abs(problem.inputs_of(p) - u) <= MARGIN_TOLERANCE * (problem.upper - problem.lower)).all():
        return unbounded
    rates = np.array(problem.path.rates(p, grid), dtype=float)  # pyright: ignore[reportArgumentType]
    return np.abs(rates).max(axis=0, initial=0.0)


def _budget_violations(problem: DesignProblem, path: Trajectory) -> list[Violation]:
    broken = []
    for budget, total in zip(problem.budgets, total_costs(problem.system, path, [budget.cost for budget in problem.budgets]), strict=True):
        margin = 1 - total / budget.at_most
        if margin < -MARGIN_TOLERANCE:
            excess, time = float(total - budget.at_most), float(path.t[-1])
            broken.append(Violation(budget, ViolationKind.BUDGET, time, excess, budget.cost.unit, float(margin)))
    return broken


def _floor_violations(problem: DesignProblem, path: Trajectory) -> list[Violation]:
    floor = problem.floor
    if floor is None:
        return []
    length = round(floor.seconds / problem.step)
    windows = sliding_information(problem.system, path, length).sum(axis=1)
    lowest = np.linalg.eigvalsh(problem.scaled(windows))[:, 0]
    first = np.unique(np.append(np.arange(0, len(lowest), max(1, length // 2)), len(lowest) - 1))
    k = int(first[lowest[first].argmin()])
    margin = float(lowest[k] / floor.value - 1)
    if margin >= -MARGIN_TOLERANCE:
        return []
    return [Violation(floor, ViolationKind.FLOOR, float(path.t[k]), float(floor.value - lowest[k]), "", margin)]
