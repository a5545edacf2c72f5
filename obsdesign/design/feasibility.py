"""Where a path breaks what is asked of it: at its nodes and between them, by how much, in units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.costs.abstract import AbstractCost
from obsdesign.design.between_nodes import FINER, Low, fine_margins, refined
from obsdesign.design.nlp.constraint_rows import node_margins, nodes_between, rows_of, tightened, window_of
from obsdesign.design.nlp.node_functions import nodes_of
from obsdesign.design.problem import DesignProblem
from obsdesign.information.windows import sliding_information
from obsdesign.trajectory import Trajectory

# rows are part of what this module is asked for
__all__ = (
    "ALLOWED",
    "Shortfall",
    "fine_margins",
    "is_feasible",
    "node_margins",
    "nodes_within",
    "price_of",
    "rows_of",
    "shortfalls",
    "spent",
    "tightened",
)

ALLOWED = 1e-6  # by how much a margin, of order 1, may fall short


@dataclass(frozen=True)
class Shortfall:
    """One limit that a path breaks."""

    what: str
    """The limit in words."""
    time: float
    """When it is broken most [s]."""
    by: float
    """By how much, in `unit`."""
    unit: str
    """Unit of `by`."""
    margin: float
    """The constraint's own margin there: < 0, of order 1."""

    def __str__(self) -> str:
        return f"{self.what}: missed by {self.by:.3g}{' ' * bool(self.unit)}{self.unit} at {self.time:.4g} s"


def nodes_within(constraint: AbstractConstraint, steps: int, step: float) -> np.ndarray:
    """Return the nodes of a grid of N steps that lie within a constraint's span, the nearest one at least."""
    first, last = window_of(constraint, steps * step)
    inside = nodes_between(first, last, steps, step)
    return inside if inside.size else np.array([min(steps, round(first / step))])


def shortfalls(problem: DesignProblem, path: Trajectory) -> tuple[Shortfall, ...]:
    """Return every limit that a path breaks, each where it does so most, worst first: constraints, bounds, rates, budgets."""
    found = [
        *_constraint_shortfalls(problem, path),
        *_input_shortfalls(problem, path),
        *_rate_shortfalls(problem, path),
        *_budget_shortfalls(problem, path),
        *_floor_shortfalls(problem, path),
    ]
    return tuple(sorted(found, key=lambda each: each.margin))


def is_feasible(problem: DesignProblem, path: Trajectory) -> bool:
    """Whether a path breaks no limit."""
    return not shortfalls(problem, path)


@np.errstate(invalid="ignore", over="ignore")  # a path may be absurd: what is no number is no margin
def _constraint_shortfalls(problem: DesignProblem, path: Trajectory) -> list[Shortfall]:
    if not nodes_of(problem.system.model, problem.constraints).owner:  # limits may limit nothing
        return []
    fine, found = fine_margins(problem, path), []
    for i, constraint in enumerate(problem.constraints):
        mine = np.flatnonzero(fine.owner == i)
        if not len(mine):
            continue
        span = constraint.span
        worst = fine.best(mine, span) if span.anywhere else min(fine.lows(mine, span), key=_value, default=None)
        if worst is not None and not worst.value >= -ALLOWED:
            size, unit = constraint.size
            found.append(Shortfall(str(constraint), worst.time, float(-worst.value * size), unit, worst.value))
    return found


def _input_shortfalls(problem: DesignProblem, path: Trajectory) -> list[Shortfall]:
    found = []
    for j, signal in enumerate(problem.system.model.inputs):
        u, width = path.u[:, j], problem.upper[j] - problem.lower[j]
        beyond = np.maximum(u - problem.upper[j], problem.lower[j] - u)
        k = int(beyond.argmax())
        if beyond[k] > ALLOWED * width:
            limits = f"{signal.name} within {problem.lower[j]:g} to {problem.upper[j]:g} {signal.unit}"
            found.append(Shortfall(limits, float(path.t[k]), float(beyond[k]), signal.unit, float(-beyond[k] / width)))
    return found


def _rate_shortfalls(problem: DesignProblem, path: Trajectory) -> list[Shortfall]:
    """Rates of change: those between neighbouring steps, or those of the family where the inputs are of it and these are less."""
    found, steps = [], np.abs(np.diff(path.u, axis=0)) / path.step
    limits = np.array([problem.rates.get(signal.name, np.inf) for signal in problem.system.model.inputs])
    if not (steps > limits * (1 + ALLOWED)).any():
        return []
    of_family = _family_rates(problem, path.u)
    for j in np.flatnonzero(np.minimum(steps.max(axis=0), of_family) > limits * (1 + ALLOWED)):
        signal, limit, k = problem.system.model.inputs[j], limits[j], int(steps[:, j].argmax())
        rate, unit = float(min(steps[k, j], of_family[j])), f"{signal.unit}/s"
        what = f"{signal.name} changing by at most {limit:g} {unit}"
        found.append(Shortfall(what, float(path.t[k + 1]), float(rate - limit), unit, float(1 - rate / limit)))
    return found


def _family_rates(problem: DesignProblem, u: np.ndarray) -> np.ndarray:
    """The largest rate of change of each input (m,) by the problem's family, inf where u (N, m) is none of it."""
    grid, none = problem.grid, np.full(u.shape[1], np.inf)
    if len(u) != grid.steps:
        return none
    p = problem.path.fit(u, grid)
    same = np.array(problem.path.inputs(p, grid), dtype=float).reshape(u.shape)  # pyright: ignore[reportArgumentType]  # serves both kinds
    if not (np.abs(same - u) <= ALLOWED * (problem.upper - problem.lower)).all():
        return none
    rates = np.array(problem.path.rates(p, grid), dtype=float)  # pyright: ignore[reportArgumentType]
    return np.abs(rates).max(axis=0, initial=0.0)


def _budget_shortfalls(problem: DesignProblem, path: Trajectory) -> list[Shortfall]:
    found = []
    for budget, total in zip(problem.budgets, spent(problem, path, tuple(budget.cost for budget in problem.budgets)), strict=True):
        margin = 1 - total / budget.at_most
        if margin < -ALLOWED:
            what = f"{budget.cost} at most {budget.at_most:g} {budget.cost.unit}".rstrip()
            found.append(Shortfall(what, float(path.t[-1]), float(total - budget.at_most), budget.cost.unit, float(margin)))
    return found


def _floor_shortfalls(problem: DesignProblem, path: Trajectory) -> list[Shortfall]:
    floor = problem.floor
    if floor is None:
        return []
    length = round(floor.seconds / problem.step)
    windows = sliding_information(problem.system, path, length).sum(axis=1)
    lowest = np.linalg.eigvalsh(problem.scaled(windows))[:, 0]
    first = np.unique(np.append(np.arange(0, len(lowest), max(1, length // 2)), len(lowest) - 1))
    k = int(first[lowest[first].argmin()])
    margin = float(lowest[k] / floor.value - 1)
    if margin >= -ALLOWED:
        return []
    what = f"Floor: lambda_min of every {floor.seconds:g} s at least {floor.value:g}"
    return [Shortfall(what, float(path.t[k]), float(floor.value - lowest[k]), "", margin)]


def price_of(problem: DesignProblem, path: Trajectory) -> float:
    """Return what the criterion loses to prices along a path."""
    if not problem.prices:
        return 0.0
    totals = spent(problem, path, tuple(price.cost for price in problem.prices))
    return float(np.array([price.per_unit for price in problem.prices]) @ totals)


def spent(problem: DesignProblem, path: Trajectory, costs: tuple[AbstractCost, ...]) -> np.ndarray:
    """Return what costs (c,) come to along a path, integrated within tenths of its steps."""
    if not costs:
        return np.zeros(0)
    step, x, u = refined(problem, path, FINER)
    return nodes_of(problem.system.model, (), costs, (step, 1)).values(x[:-1], u).sum(axis=0) * step


def _value(low: Low) -> float:
    return low.value
