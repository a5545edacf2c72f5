"""The problem from where the vehicle is: what is left of limits, budgets and family, and what is known by now."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import as_array
from obsdesign.constraints.abstract import Span
from obsdesign.costs._price_budget import Budget
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.criteria.posterior import Posterior
from obsdesign.design.checked_path import CheckedPath
from obsdesign.design.feasibility import MARGIN_TOLERANCE, LeastMargin, fine_path
from obsdesign.design.nlp.node_functions import node_functions_of
from obsdesign.design.path_costs import total_costs
from obsdesign.design.problem import DesignProblem
from obsdesign.design.violation import Violation, ViolationKind
from obsdesign.dynamics.simulation import simulate
from obsdesign.planning.plan import Memory, Plan
from obsdesign.planning.shifted_path import ShiftedConstraint, ShiftedPath, remaining_indices, shift_constraint
from obsdesign.prior import Prior
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class RemainingProblem:
    """The problem from where the vehicle is; memory: moved on to now; path: the one to fall back on.

    margins (r,): of the constraints, at x_now, inf of what need not hold there; violated: those that x_now is beyond.
    """

    problem: DesignProblem
    family: ShiftedPath
    memory: Memory
    path: Trajectory
    margins: np.ndarray
    violated: tuple[Violation, ...]

    def checked_path(self, u: np.ndarray) -> CheckedPath:
        """Return the path of inputs (N, m)."""
        return CheckedPath(self.problem, self.problem.path_along(u))


@dataclass(frozen=True, eq=False)
class MovingHorizon:
    """A problem as time goes by: each time anew, or, if it shrinks, until its duration is over."""

    problem: DesignProblem
    shrinks: bool

    @cached_property
    def initial_memory(self) -> Memory:
        """The memory before anything was flown: all inputs in the middle of their ranges."""
        problem = self.problem
        return Memory(0, problem.path.fit(self.mid_range_path.u, problem.grid), 0, spent=(0.0,) * len(problem.budgets))

    @cached_property
    def mid_range_path(self) -> Trajectory:
        """The path of these inputs from the problem's own start."""
        problem = self.problem
        return problem.path_along(np.tile(problem.grid.centre, (problem.steps, 1)))

    @property
    def period(self) -> int:
        """Steps per parameter of one input: moved by so many, a path of evenly spread parameters is one of its family again."""
        grid = self.problem.grid
        return max(1, grid.steps * len(grid.names) // max(1, len(self.initial_memory.p)))

    def remaining_problem(self, x: np.ndarray, previous: Plan | None, elapsed: int, prior: Prior | ArrayLike | None) -> RemainingProblem:
        """Return the problem from x on, so many steps after the previous plan."""
        problem = self.problem
        memory = self.initial_memory if previous is None else self._advance(previous, elapsed)
        steps = max(1, problem.steps - memory.elapsed_steps) if self.shrinks else problem.steps
        u = (
            self.mid_range_path.u
            if previous is None
            else previous.trajectory.u[remaining_indices(previous.trajectory.steps, elapsed, steps)]
        )
        path, family, floor = (
            simulate(problem.system, x, u, problem.step, tolerance=problem.tolerance),
            self._shifted_family(memory),
            problem.floor,
        )
        constraints, margins, broken = self._constraints_ahead(path, memory)
        remaining = replace(
            problem,
            start=x,
            duration=steps * problem.step,
            path=family,
            constraints=constraints,
            budgets=self._budgets(memory),
            floor=None if floor is not None and round(floor.seconds / problem.step) > steps else floor,
            **_prior_changes(problem, _criterion_ahead(problem.criterion, steps), x, prior),
        )
        return RemainingProblem(remaining, family, memory, path, margins, broken)

    def _shifted_family(self, memory: Memory) -> ShiftedPath:
        problem = self.problem
        unfixed = ShiftedPath(problem.path, problem.steps, memory.shift)
        return replace(unfixed, fixed_parameters=tuple(memory.p[~unfixed.free_mask(problem.grid)].tolist()))

    def remaining_constraints(self, memory: Memory) -> dict[int, ShiftedConstraint]:
        """Return the constraints from now on by their indices, without those whose time is over and those that have been met."""
        elapsed = memory.elapsed_steps * self.problem.step if self.shrinks else 0.0
        shifted = {i: shift_constraint(constraint, elapsed) for i, constraint in enumerate(self.problem.constraints) if i not in memory.met}
        return {i: constraint for i, constraint in shifted.items() if constraint is not None}

    def _constraints_ahead(
        self, path: Trajectory, memory: Memory
    ) -> tuple[tuple[ShiftedConstraint, ...], np.ndarray, tuple[Violation, ...]]:
        """Return the limits from now on, their margins at the start of a path, and which of them it is beyond.

        Those must hold again from when the path is back within them: to be less far beyond them nothing else shall be given up.
        """
        constraints, violated = list(self.remaining_constraints(memory).values()), []
        if not constraints:
            return (), np.zeros(0), ()
        functions = node_functions_of(self.problem.system.model, tuple(constraints))
        margins, owner = functions.values(path.x, np.vstack([path.u, path.u[-1:]])), np.array(functions.owner)
        for i, (constraint, lowest) in enumerate(zip(list(constraints), functions.least(margins).T, strict=True)):
            if constraint.shifted_span.anywhere or constraint.shifted_span.first != 0.0:
                margins[0, owner == i] = inf
                continue
            if lowest[0] >= 0:
                continue
            violated.append(LeastMargin(constraint.constraint, 0.0, float(lowest[0])).violation(ViolationKind.START))
            first, last = (int(np.argmax(lowest >= 0)) or path.steps) * self.problem.step, constraint.shifted_span.last
            constraints[i] = replace(constraint, shifted_span=Span(first, last if last is None else max(first, last)))
        return tuple(constraints), margins[0], tuple(violated)

    def _budgets(self, memory: Memory) -> tuple[Budget, ...]:
        """Return what is left of each budget; next to nothing of one that is used up."""
        pairs = zip(self.problem.budgets, memory.spent, strict=True)
        return tuple(replace(budget, at_most=max(budget.at_most - used, 1e-9 * budget.at_most)) for budget, used in pairs)

    def _advance(self, previous: Plan, steps: int) -> Memory:
        """Return a plan's memory so many steps later."""
        problem, memory = self.problem, previous.memory
        rows = None if memory.rows is None else replace(memory.rows, node=memory.rows.node - steps)
        advanced = replace(memory, elapsed_steps=memory.elapsed_steps + steps, shift=memory.shift + steps, rows=rows)
        if self.shrinks:
            met, totals = self._progress(previous, steps)
            return replace(advanced, shift=min(advanced.shift, problem.steps - 1), met=met, spent=totals)
        whole_periods = advanced.shift // self.period * self.period
        if not whole_periods:
            return advanced
        u = problem.inputs_of(memory.p)
        return replace(
            advanced,
            shift=advanced.shift - whole_periods,
            p=problem.path.fit(u[remaining_indices(len(u), whole_periods, len(u))], problem.grid),
        )

    def _progress(self, previous: Plan, steps: int) -> tuple[frozenset[int], tuple[float, ...]]:
        """Return which limits that count once have been met by now, and what is spent of each budget, as it was planned."""
        problem, memory, path = self.problem, previous.memory, previous.trajectory
        steps_flown = min(steps, path.steps)
        if not steps_flown or not (problem.budgets or any(constraint.span.anywhere for constraint in problem.constraints)):
            return memory.met, memory.spent
        part = path.part(0, steps_flown)
        total_spent = np.array(memory.spent) + total_costs(problem.system, part, [budget.cost for budget in problem.budgets])
        path_margins, met = fine_path(problem, part), set(memory.met)
        t, least = memory.elapsed_steps * problem.step + path_margins.t, path_margins.nodes.least(path_margins.margins)
        for i, constraint in enumerate(problem.constraints):
            first, last = (problem.longest if time is None else time for time in (constraint.span.first, constraint.span.last))
            in_window = (t >= first - 1e-9) & (t <= last + 1e-9)
            if constraint.span.anywhere and (least[in_window, i] >= -MARGIN_TOLERANCE).any():
                met.add(i)
        return frozenset(met), tuple(total_spent.tolist())


def _criterion_ahead(criterion: AbstractCriterion, steps: int) -> AbstractCriterion:
    """Return the criterion of the last so many steps: weights of instants are theirs, the end alone where these are all 0."""
    if not isinstance(criterion, Posterior) or isinstance(criterion.over, str) or len(criterion.over) == steps:
        return criterion
    weights = criterion.over[-steps:]
    return replace(criterion, over=weights if any(weights) else "end")


def _prior_changes(problem: DesignProblem, criterion: AbstractCriterion, x: np.ndarray, prior: Prior | ArrayLike | None) -> dict[str, Any]:
    """Return what of a problem is different with a criterion and a prior of x (n,): `known`, or the priors of criterion and draws."""
    robust, changes = problem.robust, dict[str, Any](criterion=criterion)
    information = prior.information if isinstance(prior, Prior) else None if prior is None else as_array("prior", prior)
    if robust is not None:
        covariance = robust.prior.covariance if information is None else _covariance_of(information)
        changes["robust"] = replace(robust, prior=Prior(x, covariance=covariance))
    if information is not None and isinstance(criterion, Posterior):
        changes["criterion"] = replace(criterion, prior=Prior(x, covariance=_covariance_of(information)))
    elif information is not None:
        changes["known"] = information
    return changes


def _covariance_of(information: np.ndarray) -> np.ndarray:
    covariance = np.linalg.inv(information)
    return (covariance + covariance.T) / 2
