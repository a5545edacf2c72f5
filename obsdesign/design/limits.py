"""Where a path breaks what is asked of it: at its nodes and between them, by how much, in units."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.design.nodes import Nodes, nodes_of
from obsdesign.design.problem import DesignProblem
from obsdesign.design.values import Choice, Rows
from obsdesign.information.windows import sliding_information
from obsdesign.simulation import simulate
from obsdesign.trajectory import Trajectory

FINER = 10  # steps of the check for one step of the path
ALLOWED = 1e-6  # by how much a margin, of order 1, may fall short


@dataclass(frozen=True)
class Shortfall:
    """One limit that a path breaks: what it is, when [s], by how much and in which unit; margin < 0, of order 1."""

    what: str
    time: float
    by: float
    unit: str
    margin: float

    def __str__(self) -> str:
        return f"{self.what}: missed by {self.by:.3g}{' ' * bool(self.unit)}{self.unit} at {self.time:.4g} s"


@dataclass(frozen=True, eq=False)
class Fine:
    """Margins (F, r) of the constraints on a grid ten times finer, at times t (F,)."""

    t: np.ndarray
    margins: np.ndarray
    nodes: Nodes


def nodes_within(constraint: AbstractConstraint, steps: int, step: float) -> np.ndarray:
    """Return the nodes of a grid of N steps that lie within a constraint's span, the nearest one at least."""
    span, end = constraint.span, steps * step
    first, last = (end if time is None else time for time in (span.first, span.last))
    inside = np.arange(int(np.ceil(first / step - 1e-9)), min(steps, int(np.floor(last / step + 1e-9))) + 1)
    return inside if inside.size else np.array([min(steps, round(first / step))])


def rows_of(problem: DesignProblem) -> Rows:
    """Return which margins must hold at which nodes."""
    functions = nodes_of(problem.system.model, problem.constraints, ())
    if not functions.owner:  # limits that limit nothing, such as a distance from landmarks where there are none
        return Rows(np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0))
    owner, of_inputs = np.array(functions.owner), np.array(functions.of_inputs)
    nodes, margins, choices, count = [], [], [], 0
    for i, constraint in enumerate(problem.constraints):
        mine = np.flatnonzero(owner == i)
        within = nodes_within(constraint, problem.steps, problem.step)
        if constraint.span.anywhere:
            choices.append(Choice(count + np.arange(len(mine)), within))
            nodes.append(np.full(len(mine), within[-1]))
            margins.append(mine)
            count += len(mine)
            continue
        for margin in mine:
            # the start is given: nothing can be done about it there, unless the inputs matter
            kept = within if of_inputs[margin] else within[within > 0]
            nodes.append(kept)
            margins.append(np.full(len(kept), margin))
            count += len(kept)
    node, margin = np.concatenate(nodes), np.concatenate(margins)
    return Rows(node, margin, np.zeros(len(node)), tuple(choices))


def node_margins(problem: DesignProblem, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the margins that must hold at the nodes of states x (N+1, n) with inputs u (N, m)."""
    if not problem.constraints:
        return np.zeros(0)
    rows = rows_of(problem)
    values = nodes_of(problem.system.model, problem.constraints, ()).values(x, np.vstack([u, u[-1:]]))
    return values[rows.placed(values), rows.margin]


def fine_margins(problem: DesignProblem, path: Trajectory) -> Fine:
    """Return the constraints' margins along the inputs of a path, integrated and looked at ten times as often."""
    nodes = nodes_of(problem.system.model, problem.constraints, ())
    u = np.repeat(path.u, FINER, axis=0)
    fine = simulate(problem.system, path.x[0], u, path.step / FINER)
    return Fine(fine.t, nodes.values(fine.x, np.vstack([u, u[-1:]])), nodes)


def tightened(problem: DesignProblem, path: Trajectory, rows: Rows, factor: float = 1.1) -> Rows | None:
    """Return rows that ask for `factor` times what the path falls short of between its nodes, or None where it nowhere does."""
    if not problem.constraints:
        return None
    fine = fine_margins(problem, path)
    short = np.maximum(0.0, -(fine.margins - ALLOWED / 2))
    allowance, found = rows.allowance.copy(), False
    for margin, k, everywhere in _short_of(problem, fine, short):
        near = (rows.margin == margin) & ((np.abs(rows.node * FINER - k) < FINER) | (not everywhere))
        if near.any():
            allowance[near] = np.maximum(allowance[near], rows.allowance[near] + factor * short[k, margin])
            found = True
    return replace(rows, allowance=allowance) if found else None


def _short_of(problem: DesignProblem, fine: Fine, short: np.ndarray) -> Iterator[tuple[int, int, bool]]:
    """Yield (margin, fine node, whether it must hold everywhere) of what falls short: of what must hold once, where it does so least."""
    for i, constraint in enumerate(problem.constraints):
        within = nodes_within(constraint, problem.steps * FINER, problem.step / FINER)
        mine = np.flatnonzero(np.array(fine.nodes.owner) == i)
        if constraint.span.anywhere:
            within = within[[int(fine.margins[np.ix_(within, mine)].min(axis=1).argmax())]]
        for margin in mine:
            yield from ((int(margin), int(k), not constraint.span.anywhere) for k in within[short[within, margin] > ALLOWED / 2])


def shortfalls(problem: DesignProblem, path: Trajectory) -> tuple[Shortfall, ...]:
    """Return every limit that a path breaks, each where it does so most, worst first: constraints, bounds, rates, budgets."""
    found = [
        *_constraint_shortfalls(problem, path),
        *_input_shortfalls(problem, path),
        *_budget_shortfalls(problem, path),
        *_floor_shortfalls(problem, path),
    ]
    return tuple(sorted(found, key=lambda each: each.margin))


def is_feasible(problem: DesignProblem, path: Trajectory) -> bool:
    """Whether a path breaks no limit."""
    return not shortfalls(problem, path)


def _constraint_shortfalls(problem: DesignProblem, path: Trajectory) -> list[Shortfall]:
    if not problem.constraints:
        return []
    fine, found = fine_margins(problem, path), []
    for i, constraint in enumerate(problem.constraints):
        within = nodes_within(constraint, path.steps * FINER, path.step / FINER)
        lowest = fine.margins[np.ix_(within, np.flatnonzero(np.array(fine.nodes.owner) == i))].min(axis=1, initial=np.inf)
        k = int(lowest.argmax() if constraint.span.anywhere else lowest.argmin())
        if not lowest[k] >= -ALLOWED:
            size, unit = constraint.size
            found.append(Shortfall(str(constraint), float(fine.t[within[k]]), float(-lowest[k] * size), unit, float(lowest[k])))
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


def _budget_shortfalls(problem: DesignProblem, path: Trajectory) -> list[Shortfall]:
    if not problem.budgets:
        return []
    costs = nodes_of(problem.system.model, (), tuple(budget.cost for budget in problem.budgets))
    totals = costs.values(path.x[:-1], path.u).sum(axis=0) * path.step
    found = []
    for budget, total in zip(problem.budgets, totals, strict=True):
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
    costs = nodes_of(problem.system.model, (), tuple(price.cost for price in problem.prices))
    totals = costs.values(path.x[:-1], path.u).sum(axis=0) * path.step
    return float(np.array([price.per_unit for price in problem.prices]) @ totals)
