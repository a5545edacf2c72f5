"""Receding horizon: the same problem, solved again and again from where the vehicle is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import islice
from math import gcd, inf, isfinite, isnan, nan
from numbers import Real
from time import perf_counter
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from obsdesign.analysis.query import observability
from obsdesign.analysis.verdict import UnobservableError
from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array, require_count, require_positive, whole_multiple
from obsdesign.constraints.abstract import AbstractConstraint, Coordinate, Span
from obsdesign.costs._price_budget import Budget
from obsdesign.criteria.posterior import Posterior
from obsdesign.design.blas_threads import one_thread
from obsdesign.design.feasibility import MARGIN_TOLERANCE, Violation, fine_path, initial_rows, tighten, violations
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import families_of
from obsdesign.design.nlp.criterion_objective import matrix_objective_of
from obsdesign.design.nlp.node_functions import node_functions_of
from obsdesign.design.nlp.program import ConstraintRows, Multipliers, Program
from obsdesign.design.path_costs import total_costs
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.local_model import FEASIBILITY_TOLERANCE
from obsdesign.design.sqp.solver_state import WarmStart
from obsdesign.design.sqp.trust_region_sqp import MAX_ITERATIONS as SOLVER_ITERATIONS
from obsdesign.design.sqp.trust_region_sqp import StoppingCriteria, solve
from obsdesign.display import AbstractDisplay, Summary, line_picture, number
from obsdesign.dynamics.simulation import as_state, simulate
from obsdesign.errors import InputError
from obsdesign.moment import Moment
from obsdesign.paths.abstract import AbstractPath, Grid
from obsdesign.prior import Prior
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

ITERATIONS, MIN_GAIN = 4, 5e-2  # of a warm step at most; relative gain of one after which there is no other
Horizon = Literal["receding", "shrinking"]

_FIRST_ROUNDS = 8  # of climbing again with tighter rows, in the first step
_BACK_OFF = 1e-3  # by how much climbs stay within every limit, so that one that stops early, and what is between nodes, keeps it too
_MIN_RADIUS = 0.03  # of the trust region at least, in widths of the box: the start has moved since the last climb
_SPARE_ITERATIONS, _CHECK_SECONDS = (
    1.5,
    0.015,
)  # left unused before a deadline: iterations' worth of time, and seconds for what follows the climb
_ITERATION_SECONDS, _ITERATION_DECAY = (
    0.05,
    0.8,
)  # seconds an iteration is taken to last before one was timed; share kept where none was made
_REHEARSAL_STEPS = 8  # steps at most that are taken at construction


# ---------------------------------------------------------------- a problem some time later


@dataclass(frozen=True)
class ShiftedConstraint(AbstractConstraint):
    """A constraint with another span; equal to others of the same constraint, as the functions of its margins are the same."""

    constraint: AbstractConstraint
    shifted_span: Span = field(compare=False)

    def __str__(self) -> str:
        return str(self.constraint)

    @property
    def span(self) -> Span:
        return self.shifted_span

    @property
    def states(self) -> tuple[str, ...]:
        return self.constraint.states

    @property
    def size(self) -> tuple[float, str]:
        return self.constraint.size

    def margins(self, moment: Moment) -> list[Coordinate]:
        return self.constraint.margins(moment)


def _shift_constraint(constraint: AbstractConstraint, elapsed: float) -> ShiftedConstraint | None:
    """Return a constraint as of `elapsed` [s] later, None where its time is over."""
    span = constraint.span
    first, last = (None if time is None else max(0.0, time - elapsed) for time in (span.first, span.last))
    is_over = span.last is not None and span.last < elapsed - 1e-9
    return None if is_over else ShiftedConstraint(constraint, Span(first, last, span.anywhere))


@dataclass(frozen=True)
class ShiftedPath(AbstractPath):
    """The inputs of a family on a grid of `family_steps` steps from its step `shift` on, the last ones held for as long as they have to be.

    So a path that has been flown in part stays in its family, wherever in a piece the vehicle is. Parameters that only what has
    been flown depended on are constants: `fixed_parameters`, in the order of their indices.
    """

    family: AbstractPath
    family_steps: int
    shift: int
    fixed_parameters: tuple[float, ...] = ()

    def box(self, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
        is_free = self.free_mask(grid)
        lower, upper = self.family.box(self._family_grid(grid))
        return lower[is_free], upper[is_free]

    def inputs(self, p: ca.SX, grid: Grid) -> ca.SX:
        return self.family.inputs(self.all_parameters(p, grid), self._family_grid(grid))[
            _remaining_indices(self.family_steps, self.shift, grid.steps).tolist(), :
        ]

    def fit(self, u: np.ndarray, grid: Grid) -> np.ndarray:
        extended = np.vstack([np.repeat(u[:1], self.shift, axis=0), u])[: self.family_steps]
        return self.family.fit(extended, self._family_grid(grid))[self.free_mask(grid)]

    def coarser(self) -> None:
        return None

    def rates(self, p: ca.SX, grid: Grid) -> ca.SX:
        return self.family.rates(self.all_parameters(p, grid), self._family_grid(grid))

    def free_mask(self, grid: Grid) -> np.ndarray:
        """Return which of the family's parameters (q,) what is left of the path depends on."""
        return _free_mask(self.family, self._family_grid(grid), self.shift)

    def all_parameters(self, p: Any, grid: Grid) -> Any:  # noqa: ANN401  # symbolic or numerical
        """Return the family's parameters (q,)."""
        if not self.fixed_parameters:
            return p
        is_free, free, fixed = self.free_mask(grid), iter(p if isinstance(p, np.ndarray) else ca.vertsplit(p)), iter(self.fixed_parameters)
        all_values = [next(free) if is_parameter_free else next(fixed) for is_parameter_free in is_free]
        return np.array(all_values) if isinstance(p, np.ndarray) else ca.vertcat(*all_values)

    def _family_grid(self, grid: Grid) -> Grid:
        return replace(grid, steps=self.family_steps)


@lru_cache(256)
def _free_mask(family: AbstractPath, grid: Grid, shift: int) -> np.ndarray:
    p = ca.SX.sym("p", len(family.box(grid)[0]))
    remaining = ca.vec(ca.SX(family.inputs(p, grid))[shift:, :])
    return np.array(ca.which_depends(remaining, p, 1, False), dtype=bool)


def _remaining_indices(count: int, shift: int, steps: int) -> np.ndarray:
    """Return indices (steps,) of what comes from `shift` on, the last of `count` again and again at the end."""
    return np.minimum(np.arange(shift, shift + steps), count - 1)


# ---------------------------------------------------------------- records


@dataclass(frozen=True, eq=False)
class Memory:
    """What a step hands on to the next.

    elapsed_steps: steps since the first plan; p (q,): parameters of the problem's family on its own grid, the first `shift` steps of which
    have been flown; rows, warm_start: of the last climb, constraint_indices: indices of its constraints; met: indices of those that must
    hold once and have; spent: of each budget; pace [s]: of one iteration.
    """

    elapsed_steps: int
    p: np.ndarray
    shift: int
    rows: ConstraintRows | None = None
    warm_start: WarmStart | None = None
    constraint_indices: tuple[int, ...] = ()
    met: frozenset[int] = frozenset()
    spent: tuple[float, ...] = ()
    iteration_seconds: float = _ITERATION_SECONDS


@dataclass(frozen=True, eq=False)
class Plan(AbstractDisplay):
    """A path from where the vehicle is."""

    trajectory: Trajectory
    """The path, from x_now at its t = 0 on."""
    value: float
    """What is maximised, recomputed: criterion(S (W + prior) S) minus prices; NaN where that was not done."""
    status: Status
    """How this step's solve ended, ITERATION_LIMIT being usual."""
    feasible: bool
    """Whether the path begins at x_now and breaks no limit, looked at ten times as often as the steps."""
    reason: str
    """What went wrong or is broken, in words; "" = nothing."""
    age: int
    """How many plans ago the inputs were found, 0 = in this one."""
    time: float
    """Time since the first plan [s]."""
    seconds: float
    """Wall time that the step took [s]."""
    memory: Memory
    """What the next step goes on from."""

    def _summary(self) -> Summary:
        path = self.trajectory
        rows = [
            ("value", number(self.value)),
            ("limits", "all kept" if self.feasible else self.reason),
            ("path", f"{path.steps} steps of {number(path.step, 's')}"),
            ("inputs found", f"{self.age} steps ago" if self.age else "now"),
            ("took", number(self.seconds, "s")),
        ]
        return Summary(f"plan at {number(self.time, 's')}: {self.status.value}", tuple(rows), line_picture(path.x[:, 0], path.x[:, 1]))

    @property
    def x0(self) -> np.ndarray:
        """Where the path begins (n,)."""
        return self.trajectory.x[0]

    @property
    def p(self) -> np.ndarray:
        """Parameters (q,) that the next climb begins from: those of the path, or of one that did not keep all limits yet."""
        return self.memory.p


# ---------------------------------------------------------------- the problem from now on


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
        return CheckedPath(
            self.problem, simulate(self.problem.system, self.problem.x0, u, self.problem.step, tolerance=self.problem.tolerance)
        )


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
        return simulate(
            problem.system, problem.x0, np.tile(problem.grid.centre, (problem.steps, 1)), problem.step, tolerance=problem.tolerance
        )

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
            else previous.trajectory.u[_remaining_indices(previous.trajectory.steps, elapsed, steps)]
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
            **_prior_changes(problem, x, prior),
        )
        return RemainingProblem(remaining, family, memory, path, margins, broken)

    def _shifted_family(self, memory: Memory) -> ShiftedPath:
        problem = self.problem
        unfixed = ShiftedPath(problem.path, problem.steps, memory.shift)
        return replace(unfixed, fixed_parameters=tuple(memory.p[~unfixed.free_mask(problem.grid)].tolist()))

    def remaining_constraints(self, memory: Memory) -> dict[int, ShiftedConstraint]:
        """Return the constraints from now on by their indices, without those whose time is over and those that have been met."""
        elapsed = memory.elapsed_steps * self.problem.step if self.shrinks else 0.0
        shifted = {
            i: _shift_constraint(constraint, elapsed) for i, constraint in enumerate(self.problem.constraints) if i not in memory.met
        }
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
        for i, constraint in enumerate(constraints):
            lowest = margins[:, owner == i].min(axis=1, initial=inf)
            if constraint.shifted_span.anywhere or constraint.shifted_span.first != 0.0:
                margins[0, owner == i] = inf
                continue
            if lowest[0] >= 0:
                continue
            size, unit = constraint.size
            violated.append(Violation(str(constraint), 0.0, float(-lowest[0] * size), unit, float(lowest[0])))
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
        u = _inputs(problem, memory.p)
        return replace(
            advanced,
            shift=advanced.shift - whole_periods,
            p=problem.path.fit(u[_remaining_indices(len(u), whole_periods, len(u))], problem.grid),
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
        t, owner = memory.elapsed_steps * problem.step + path_margins.t, np.array(path_margins.nodes.owner)
        for i, constraint in enumerate(problem.constraints):
            first, last = (problem.longest if time is None else time for time in (constraint.span.first, constraint.span.last))
            in_window = (t >= first - 1e-9) & (t <= last + 1e-9)
            if (
                constraint.span.anywhere
                and (path_margins.margins[np.ix_(in_window, owner == i)].min(axis=1, initial=inf) >= -MARGIN_TOLERANCE).any()
            ):
                met.add(i)
        return frozenset(met), tuple(total_spent.tolist())


def _prior_changes(problem: DesignProblem, x: np.ndarray, prior: Prior | ArrayLike | None) -> dict[str, Any]:
    """Return what of a problem is different with a prior of x (n,): `known`, or the priors of criterion and draws."""
    robust, changes = problem.robust, {}
    information = prior.information if isinstance(prior, Prior) else None if prior is None else as_array("prior", prior)
    if robust is not None:
        covariance = robust.prior.covariance if information is None else _covariance_of(information)
        changes["robust"] = replace(robust, prior=Prior(x, covariance=covariance))
    if information is not None and isinstance(problem.criterion, Posterior):
        changes["criterion"] = replace(problem.criterion, prior=Prior(x, covariance=_covariance_of(information)))
    elif information is not None:
        changes["known"] = information
    return changes


def _covariance_of(information: np.ndarray) -> np.ndarray:
    covariance = np.linalg.inv(information)
    return (covariance + covariance.T) / 2


# ---------------------------------------------------------------- climbs


@dataclass(frozen=True, eq=False)
class CheckedPath:
    """A path under the limits of a problem."""

    problem: DesignProblem
    path: Trajectory

    @cached_property
    def violations(self) -> tuple[Violation, ...]:
        """What it breaks, worst first."""
        return violations(self.problem, self.path)

    @cached_property
    def objective(self) -> float:
        """What is maximised, recomputed."""
        return self.problem.objective(self.path)

    def better_of(self, rival: CheckedPath) -> CheckedPath:
        """Return the better one: feasible rather than not, then of higher objective, or of later and less shortfall."""
        if not self.violations:
            # looking between the nodes takes longer than the rest: only where it matters
            return self if self.objective >= rival.objective or rival.violations else rival
        return self if rival.violations and self._severity > rival._severity else rival

    @property
    def _severity(self) -> tuple[float, float]:
        """When it comes, and how bad it is: what is far ahead will be planned again."""
        return min(violation.time for violation in self.violations), self.violations[0].margin


@dataclass(frozen=True, eq=False)
class SolveStart:
    """Where a climb begins."""

    p: np.ndarray
    rows: ConstraintRows
    warm_start: WarmStart | None


@dataclass(frozen=True, eq=False)
class SolveLimits:
    """How many climbs within what limits; min_gain: the relative gain of one after which there is no other."""

    rounds: int
    stopping: StoppingCriteria
    min_gain: float


@dataclass(frozen=True, eq=False)
class SolveResult:
    """The best path known, where a next climb would begin, how the climb ended, and seconds per iteration, 0 = none was made."""

    checked: CheckedPath
    next_start: SolveStart | None
    status: Status
    iteration_seconds: float


def _solve_and_check(problem: DesignProblem, fallback: CheckedPath, start: SolveStart, limits: SolveLimits) -> SolveResult:
    """Climb, look between the nodes, tighten, climb again, until this keeps all limits and gains little more."""
    best, status, iterations, start_time, before = fallback, Status.TIME_LIMIT, 0, perf_counter(), fallback.objective
    for _ in range(limits.rounds):
        if perf_counter() >= limits.stopping.deadline:
            status = Status.TIME_LIMIT
            break
        solution = solve(Program(problem, start.rows), matrix_objective_of(problem), start.p, start.warm_start, stopping=limits.stopping)
        checked = CheckedPath(
            problem, simulate(problem.system, problem.x0, _inputs(problem, solution.p), problem.step, tolerance=problem.tolerance)
        )
        best, status, iterations = checked.better_of(best), solution.status, iterations + solution.iterations
        # a climb that has not come to terms with its rows yet says nothing about what they leave out
        rows = tighten(problem, checked.path, start.rows) if checked.violations and solution.violation <= FEASIBILITY_TOLERANCE else None
        warm_start = solution.warm_start
        if rows is not None:
            warm_start = replace(warm_start, multipliers=warm_start.multipliers.with_rows(len(start.rows.node), len(rows.node)))
        start = SolveStart(solution.p, start.rows if rows is None else rows, warm_start)
        gain, before = solution.objective - before, solution.objective
        if not checked.violations and gain <= limits.min_gain * abs(before):
            break
        if rows is None and status is not Status.ITERATION_LIMIT:
            break
    return SolveResult(best, start, status, (perf_counter() - start_time) / iterations if iterations else 0.0)


def _inputs(problem: DesignProblem, p: np.ndarray) -> np.ndarray:
    """Return u (N, m) of parameters (q,)."""
    u: Any = problem.path.inputs(p, problem.grid)  # pyright: ignore[reportArgumentType]  # serves both kinds
    return np.asarray(u, dtype=float).reshape(problem.steps, -1)


def _warm_start(remaining: RemainingProblem, constraint_indices: tuple[int, ...]) -> SolveStart:
    """Return where the last climb stopped, its rows and multipliers moved on in time."""
    grid, family, memory, rows = remaining.problem.grid, remaining.family, remaining.memory, initial_rows(remaining.problem)
    p = np.clip(memory.p[family.free_mask(grid)], *family.box(grid))
    # of a limit that is nearer than that, half of what there is
    back_off = np.clip(remaining.margins[rows.margin] / 2, 0.0, _BACK_OFF)
    old_rows, warm_start = memory.rows, memory.warm_start
    if old_rows is None or memory.constraint_indices != constraint_indices:
        return SolveStart(p, replace(rows, allowance=back_off), warm_start)
    matching = _matching_rows(rows, old_rows)
    rows = replace(rows, allowance=np.maximum(np.append(old_rows.allowance, 0.0)[matching], back_off))
    row_multipliers = None if warm_start is None else warm_start.multipliers.rows[: len(old_rows.node)]
    active_between = _active_between_nodes(old_rows, remaining.problem.steps, row_multipliers)
    rows, matching = rows.extend(old_rows.select(active_between)), np.append(matching, active_between)
    if warm_start is None:
        return SolveStart(p, rows, None)
    old_multipliers, count = warm_start.multipliers, len(old_rows.node)
    new_row_multipliers = np.concatenate([np.append(old_multipliers.rows[:count], 0.0)[matching], old_multipliers.rows[count:]])
    multipliers = Multipliers(old_multipliers.matrices, old_multipliers.floors, new_row_multipliers, old_multipliers.price)
    return SolveStart(p, rows, replace(warm_start, multipliers=multipliers, radius=max(warm_start.radius, _MIN_RADIUS)))


def _active_between_nodes(old: ConstraintRows, steps: int, row_multipliers: np.ndarray | None) -> np.ndarray:
    """Return the indices of old rows between nodes that lie ahead and that the last climb leaned on; without one, of all ahead."""
    is_choice = np.zeros(len(old.node), dtype=bool)
    for choice in old.choices:
        is_choice[choice.rows] = True
    ahead = (old.delay > 0) & (old.node >= 0) & (old.node < steps) & ~is_choice
    return np.flatnonzero(ahead if row_multipliers is None else ahead & (row_multipliers > 0))


def _matching_rows(rows: ConstraintRows, old: ConstraintRows) -> np.ndarray:
    """Return for each row the index of the old one at its instant, -1 without one; what counts at one instant only stays the same."""
    shape = [max(values.max(initial=0) for values in pair) + 1 for pair in ((rows.node, old.node), (rows.margin, old.margin))]
    row_at, row_of_margin = np.full(shape, -1), np.full(shape[1], -1)
    ahead = np.flatnonzero((old.node >= 0) & (old.delay == 0))
    row_at[old.node[ahead], old.margin[ahead]] = ahead
    at_node = np.flatnonzero(old.delay == 0)
    row_of_margin[old.margin[at_node]] = at_node
    is_single = np.bincount(rows.margin, minlength=shape[1])[rows.margin] == 1
    return np.where(is_single, row_of_margin[rows.margin], np.where(rows.delay == 0, row_at[rows.node, rows.margin], -1))


def _next_memory(remaining: RemainingProblem, result: SolveResult, constraint_indices: tuple[int, ...], is_fallback: bool) -> Memory:
    """Return what the next step begins with: where the climb stopped, or the path itself after a climb that failed."""
    grid, family, next_start = remaining.problem.grid, remaining.family, result.next_start
    memory = replace(
        remaining.memory,
        iteration_seconds=result.iteration_seconds or _ITERATION_DECAY * remaining.memory.iteration_seconds,
        constraint_indices=constraint_indices,
    )
    has_failed = result.status in (Status.NUMERICAL_ERROR, Status.LOCALLY_INFEASIBLE)
    if next_start is None or (is_fallback and has_failed):
        return replace(memory, p=family.all_parameters(family.fit(result.checked.path.u, grid), grid), warm_start=None)
    return replace(memory, p=family.all_parameters(next_start.p, grid), rows=next_start.rows, warm_start=next_start.warm_start)


def _try_other_ends(remaining: RemainingProblem, checked: CheckedPath, from_step: int) -> CheckedPath:
    """Return what is better than a path that breaks a limit: the path to fall back on with another end, from step `from_step` on."""
    problem, u = remaining.problem, remaining.path.u
    if from_step >= len(u):
        return checked
    for last in (problem.lower, problem.upper, problem.grid.centre):
        if not checked.violations:
            break
        checked = remaining.checked_path(np.vstack([u[:from_step], np.tile(last, (len(u) - from_step, 1))])).better_of(checked)
    return checked


# ---------------------------------------------------------------- the planner


@dataclass(frozen=True, eq=False)
class StepArguments:
    """The arguments of one step, as they came."""

    x_now: ArrayLike
    previous: Plan | None
    prior: Prior | ArrayLike | None
    deadline: float | None
    elapsed: float | None
    start_time: float

    def latest_start(self, iteration_seconds: float) -> float:
        """Return after when no iteration may begin."""
        if self.deadline is None:
            return inf
        if not isinstance(self.deadline, Real) or isnan(self.deadline):
            raise InputError(f"deadline is {self.deadline!r}: must be a number of seconds")
        return self.start_time + float(self.deadline) - _SPARE_ITERATIONS * iteration_seconds - _CHECK_SECONDS


@validate_arguments
@dataclass(frozen=True)
class Planner:
    """Plans for one problem from wherever the vehicle is, again and again.

    Built once; the warm start travels in the plan: no hidden state. What takes long for being done the first time is done at
    construction, by rehearsing some steps. Rates are limits within each plan.
    Raises UnobservableError where the sensors cannot see the whole state on any path, InputError for a duration to choose from and
    for values that do not fit. Source: Diehl, Bock and Schlöder (2005), real-time iterations.
    """

    problem: DesignProblem
    """What each plan answers, of one duration."""
    every: float | None = None
    """Time from one step to the next [s], a whole multiple of the problem's step; None = one step."""
    horizon: Horizon = "receding"
    """"receding": each plan lasts as long as the problem, whose limits count from now on; "shrinking": until the duration of the problem is
    over, limits and budgets being those of the whole mission.
    """
    iterations: int = ITERATIONS
    """Largest number of iterations of a step after the first (real-time iteration: the next one goes on from there)."""
    enough: float = MIN_GAIN
    """Relative gain of one iteration below which the step is done."""
    starts: int = 4
    """Number of initial guesses of the first step, which is solved to the end."""
    seed: int = 0
    """Seed of these guesses."""

    def __post_init__(self) -> None:
        problem = self.problem
        if problem.shortest != problem.longest:
            raise InputError(f"planner: duration is {problem.duration!r}: must be one number of seconds")
        if self.horizon not in ("receding", "shrinking"):
            raise InputError(f"planner: horizon is {self.horizon!r}: must be 'receding' or 'shrinking'")
        require_count("planner: iterations", self.iterations)
        require_positive("planner: enough", self.enough)
        require_count("planner: starts", self.starts)
        require_count("planner: seed", self.seed, minimum=0)
        period = self._moving_horizon.period // gcd(self._moving_horizon.period, self._interval_steps)
        verdict = observability(problem.system, seed=self.seed)
        if verdict.decided and not verdict.observable and not problem.about and not np.any(problem.known):
            raise UnobservableError(verdict)
        plan = self._fallback_plan
        for _ in range(min(_REHEARSAL_STEPS, 2 if self._moving_horizon.shrinks else period)):
            plan = self.step(problem.x0, plan)

    def step(
        self,
        x_now: ArrayLike,
        previous: Plan | None = None,
        prior: Prior | ArrayLike | None = None,
        deadline: float | None = None,
        elapsed: float | None = None,
    ) -> Plan:
        """Return a plan from where the vehicle is. Never raises: what goes wrong is the plan's status and reason.

        The path is the better one of a local solve from the previous path, moved on in time, and of that path itself; it breaks no
        limit if either of them breaks none. After a failure or at the deadline it is the previous path, moved on; where x_now is no
        state, from where that path is now, which is not called feasible. Errors of samples that last begin anew in each plan: what
        earlier samples have told of them is not in `prior`, nor that they are in it.

        Arguments:
            x_now (n,): the state now, in the units of the states.
            previous: the last plan; None = there is none: several starts are tried.
            prior: what is known about x_now beside the samples that the plan counts, those at t = 0 among them, as Prior or
                information (n, n); None = the problem's `known`.
            deadline: wall time from the call [s]; None = none: then the same arguments give the same plan, `seconds` and the
                memory's pace apart.
            elapsed: how long the previous plan has been flown [s], to the nearest number of steps; None = `every`.
        """
        arguments, reason = StepArguments(x_now, previous, prior, deadline, elapsed, perf_counter()), ""
        attempts: tuple[Callable[[StepArguments], Plan], ...] = (self._solve, self._follow_inputs, self._follow_path, self._hold_mid_range)
        for attempt in attempts:
            try:
                with one_thread():
                    plan = attempt(arguments)
                reason = "; ".join(filter(None, (reason, plan.reason)))
                return replace(plan, reason=reason, seconds=perf_counter() - arguments.start_time)
            except Exception as error:  # noqa: BLE001  # in flight any plan is better than none; each attempt needs less than the last
                reason = reason or str(error) or type(error).__name__
        return replace(self._fallback_plan, reason=reason, seconds=perf_counter() - arguments.start_time)

    # ------------------------------------------------------------ attempts

    def _solve(self, arguments: StepArguments) -> Plan:
        """Climb from the previous path, or from several starts."""
        x, previous = as_state(self.problem.system, arguments.x_now, "x_now"), arguments.previous
        elapsed = 0 if previous is None else self._elapsed_steps(arguments)
        remaining = self._moving_horizon.remaining_problem(x, previous, elapsed, arguments.prior)
        constraint_indices, deadline, fallback = (
            tuple(self._moving_horizon.remaining_constraints(remaining.memory)),
            arguments.latest_start(remaining.memory.iteration_seconds),
            CheckedPath(remaining.problem, remaining.path),
        )
        if previous is None:
            result, checked = self._first_solve(remaining, fallback, deadline), fallback
        else:
            limits = SolveLimits(self.iterations, StoppingCriteria(1, deadline=deadline), self.enough)
            result = _solve_and_check(remaining.problem, fallback, _warm_start(remaining, constraint_indices), limits)
            checked = _try_other_ends(remaining, result.checked, max(0, previous.trajectory.steps - elapsed))
        is_fallback = result.checked is fallback
        checked = result.checked if previous is None else checked
        age = previous.age + 1 if previous is not None and (is_fallback or checked is not result.checked) else 0
        return self._build_plan(remaining, checked, result.status, age, _next_memory(remaining, result, constraint_indices, is_fallback))

    def _follow_inputs(self, arguments: StepArguments) -> Plan:
        """Fly the previous path's inputs from x_now."""
        remaining, age = self._previous_problem(arguments)
        x = as_state(self.problem.system, arguments.x_now, "x_now")
        checked = CheckedPath(
            remaining.problem, simulate(self.problem.system, x, remaining.path.u, self.problem.step, tolerance=self.problem.tolerance)
        )
        return self._build_plan(remaining, checked, Status.NUMERICAL_ERROR, age, remaining.memory)

    def _follow_path(self, arguments: StepArguments) -> Plan:
        """Fly the previous path, x_now being no state."""
        remaining, age = self._previous_problem(arguments)
        return replace(
            self._build_plan(remaining, CheckedPath(remaining.problem, remaining.path), Status.NUMERICAL_ERROR, age, remaining.memory),
            feasible=False,
        )

    def _previous_problem(self, arguments: StepArguments) -> tuple[RemainingProblem, int]:
        """Return the problem from where the previous path is now, and its age."""
        previous = arguments.previous
        if previous is None:
            raise InputError("there is no plan to follow")
        elapsed = self._elapsed_steps(arguments) if _is_time(arguments.elapsed) else self._interval_steps
        x = previous.trajectory.x[min(elapsed, previous.trajectory.steps)]
        cold_previous = replace(previous, memory=replace(previous.memory, warm_start=None))
        return self._moving_horizon.remaining_problem(x, cold_previous, elapsed, None), previous.age + 1

    def _hold_mid_range(self, arguments: StepArguments) -> Plan:
        """All inputs in the middle of their ranges, from x_now."""
        x = as_state(self.problem.system, arguments.x_now, "x_now")
        path = simulate(self.problem.system, x, self._moving_horizon.mid_range_path.u, self.problem.step, tolerance=self.problem.tolerance)
        return replace(self._fallback_plan, trajectory=path, feasible=not violations(self.problem, path))

    @property
    def _fallback_plan(self) -> Plan:
        """The same from the problem's own start, made before anything could go wrong."""
        return Plan(
            self._moving_horizon.mid_range_path, nan, Status.NUMERICAL_ERROR, False, "", 0, 0.0, 0.0, self._moving_horizon.initial_memory
        )

    def _build_plan(self, remaining: RemainingProblem, checked: CheckedPath, status: Status, age: int, memory: Memory) -> Plan:
        all_violations = (*remaining.violated, *checked.violations)
        # after an error nothing is computed that may be what went wrong
        value = nan if status is Status.NUMERICAL_ERROR else checked.objective
        return Plan(
            checked.path,
            value,
            status,
            not all_violations,
            "; ".join(map(str, all_violations[:3])),
            age,
            memory.elapsed_steps * self.problem.step,
            0.0,
            memory,
        )

    def _first_solve(self, remaining: RemainingProblem, fallback: CheckedPath, deadline: float) -> SolveResult:
        """Climb from the most promising starts, coarse families first."""
        unviolated = self.problem if remaining.violated else replace(remaining.problem, constraints=self.problem.constraints)
        best, limits = (
            SolveResult(fallback, None, Status.TIME_LIMIT, 0.0),
            SolveLimits(_FIRST_ROUNDS, StoppingCriteria(SOLVER_ITERATIONS, deadline=deadline), inf),
        )
        starts = [
            remaining.checked_path(u)
            for _, u in islice(start_inputs(unviolated, self.seed), self.starts if perf_counter() < deadline else 0)
        ]
        for start in sorted(starts, key=lambda checked: (bool(checked.violations), -checked.objective)):
            if perf_counter() >= deadline:
                break
            result = SolveResult(start, None, Status.TIME_LIMIT, 0.0)
            for family in (*families_of(self.problem.path)[:-1], remaining.family):
                problem = replace(remaining.problem, path=family)
                solve_start = SolveStart(family.fit(result.checked.path.u, problem.grid), initial_rows(problem), None)
                result = _solve_and_check(problem, result.checked, solve_start, limits)
            best = result if result.checked.better_of(best.checked) is result.checked else best
        return best

    # ------------------------------------------------------------ time

    @cached_property
    def _moving_horizon(self) -> MovingHorizon:
        return MovingHorizon(self.problem, self.horizon == "shrinking")

    @property
    def _interval_steps(self) -> int:
        """Steps from one plan to the next."""
        interval = self.problem.step if self.every is None else self.every
        steps = whole_multiple(interval, self.problem.step) if _is_time(interval) and interval else None
        if steps is None:
            raise InputError(f"planner: every is {interval!r}: must be a whole multiple of the step {self.problem.step:g} s")
        return steps

    def _elapsed_steps(self, arguments: StepArguments) -> int:
        """Steps since the previous plan."""
        if arguments.elapsed is None:
            return self._interval_steps
        if not _is_time(arguments.elapsed):
            raise InputError(f"elapsed is {arguments.elapsed!r}: must be a finite number of seconds, at least 0")
        return round(arguments.elapsed / self.problem.step)


def _is_time(value: object) -> bool:
    return isinstance(value, (int, float)) and isfinite(value) and value >= 0
