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
from obsdesign.design.best_design import objective_of
from obsdesign.design.blas_threads import one_thread
from obsdesign.design.feasibility import ALLOWED, Shortfall, fine_margins, rows_of, shortfalls, spent, tightened
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import families_of
from obsdesign.design.nlp.node_functions import nodes_of
from obsdesign.design.nlp.program import Multipliers, Program, Rows
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.matrix_objective import aim_of
from obsdesign.design.sqp.trust_region_sqp import FEASIBLE, Limits, Warm, climb
from obsdesign.design.sqp.trust_region_sqp import ITERATIONS as TO_THE_END
from obsdesign.display import AbstractDisplay, Summary, line_picture, number
from obsdesign.dynamics.simulation import as_state, simulate
from obsdesign.errors import InputError
from obsdesign.moment import Moment
from obsdesign.paths.abstract import AbstractPath, Grid
from obsdesign.prior import Prior
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

ITERATIONS, ENOUGH = 4, 5e-2  # of a warm step at most; relative gain of one after which there is no other
Horizon = Literal["receding", "shrinking"]

_FIRST_ROUNDS = 8  # of climbing again with tighter rows, in the first step
_BACK = 1e-3  # by how much climbs stay within every limit, so that one that stops early, and what is between nodes, keeps it too
_RADIUS = 0.03  # of the trust region at least, in widths of the box: the start has moved since the last climb
_SPARE, _AFTER = 1.5, 0.015  # left unused before a deadline: iterations' worth of time, and seconds for what follows the climb
_PACE, _PACE_KEPT = 0.05, 0.8  # seconds an iteration is taken to last before one was timed; share kept where none was made
_REHEARSED = 8  # steps at most that are taken at construction


# ---------------------------------------------------------------- a problem some time later


@dataclass(frozen=True)
class _Later(AbstractConstraint):
    """A constraint with another span; equal to others of the same constraint, as the functions of its margins are the same."""

    constraint: AbstractConstraint
    when: Span = field(compare=False)

    def __str__(self) -> str:
        return str(self.constraint)

    @property
    def span(self) -> Span:
        return self.when

    @property
    def states(self) -> tuple[str, ...]:
        return self.constraint.states

    @property
    def size(self) -> tuple[float, str]:
        return self.constraint.size

    def margins(self, moment: Moment) -> list[Coordinate]:
        return self.constraint.margins(moment)


def _later(constraint: AbstractConstraint, gone: float) -> _Later | None:
    """Return a constraint as of `gone` [s] later, None where its time is over."""
    span = constraint.span
    first, last = (None if time is None else max(0.0, time - gone) for time in (span.first, span.last))
    over = span.last is not None and span.last < gone - 1e-9
    return None if over else _Later(constraint, Span(first, last, span.anywhere))


@dataclass(frozen=True)
class _Moved(AbstractPath):
    """The inputs of a family on a grid of `whole` steps from its step `by` on, the last ones held for as long as they have to be.

    So a path that has been flown in part stays in its family, wherever in a piece the vehicle is. Parameters that only what has
    been flown depended on are constants: `flown`, in the order of their indices.
    """

    family: AbstractPath
    whole: int
    by: int
    flown: tuple[float, ...] = ()

    def box(self, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
        live = self.live(grid)
        lower, upper = self.family.box(self._grid(grid))
        return lower[live], upper[live]

    def inputs(self, p: ca.SX, grid: Grid) -> ca.SX:
        return self.family.inputs(self.full(p, grid), self._grid(grid))[_onward(self.whole, self.by, grid.steps).tolist(), :]

    def fit(self, u: np.ndarray, grid: Grid) -> np.ndarray:
        every = np.vstack([np.repeat(u[:1], self.by, axis=0), u])[: self.whole]
        return self.family.fit(every, self._grid(grid))[self.live(grid)]

    def coarser(self) -> None:
        return None

    def rates(self, p: ca.SX, grid: Grid) -> ca.SX:
        return self.family.rates(self.full(p, grid), self._grid(grid))

    def live(self, grid: Grid) -> np.ndarray:
        """Return which of the family's parameters (q,) what is left of the path depends on."""
        return _live(self.family, self._grid(grid), self.by)

    def full(self, p: Any, grid: Grid) -> Any:  # noqa: ANN401  # symbolic or numerical
        """Return the family's parameters (q,)."""
        if not self.flown:
            return p
        live, parts, gone = self.live(grid), iter(p if isinstance(p, np.ndarray) else ca.vertsplit(p)), iter(self.flown)
        every = [next(parts) if is_live else next(gone) for is_live in live]
        return np.array(every) if isinstance(p, np.ndarray) else ca.vertcat(*every)

    def _grid(self, grid: Grid) -> Grid:
        return replace(grid, steps=self.whole)


@lru_cache(256)
def _live(family: AbstractPath, grid: Grid, by: int) -> np.ndarray:
    p = ca.SX.sym("p", len(family.box(grid)[0]))
    left = ca.vec(ca.SX(family.inputs(p, grid))[by:, :])
    return np.array(ca.which_depends(left, p, 1, False), dtype=bool)


def _onward(count: int, by: int, steps: int) -> np.ndarray:
    """Return indices (steps,) of what comes from `by` on, the last of `count` again and again at the end."""
    return np.minimum(np.arange(by, by + steps), count - 1)


# ---------------------------------------------------------------- records


@dataclass(frozen=True, eq=False)
class Memory:
    """What a step hands on to the next.

    gone: steps since the first plan; p (q,): parameters of the problem's family on its own grid, the first `by` steps of which have
    been flown; rows, warm: of the last climb, limits: indices of its constraints; met: indices of those that must hold once and
    have; spent: of each budget; pace [s]: of one iteration.
    """

    gone: int
    p: np.ndarray
    by: int
    rows: Rows | None = None
    warm: Warm | None = None
    limits: tuple[int, ...] = ()
    met: frozenset[int] = frozenset()
    spent: tuple[float, ...] = ()
    pace: float = _PACE


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
class _Now:
    """The problem from where the vehicle is; memory: moved on to now; path: the one to fall back on.

    margins (r,): of the constraints, at x_now, inf of what need not hold there; broken: those that x_now is beyond.
    """

    problem: DesignProblem
    family: _Moved
    memory: Memory
    path: Trajectory
    margins: np.ndarray
    broken: tuple[Shortfall, ...]

    def course(self, u: np.ndarray) -> _Course:
        """Return the path of inputs (N, m)."""
        return _Course(self.problem, simulate(self.problem.system, self.problem.x0, u, self.problem.step, tolerance=self.problem.tolerance))


@dataclass(frozen=True, eq=False)
class _Mission:
    """A problem as time goes by: each time anew, or, if it shrinks, until its duration is over."""

    problem: DesignProblem
    shrinks: bool

    @cached_property
    def fresh(self) -> Memory:
        """The memory before anything was flown: all inputs in the middle of their ranges."""
        problem = self.problem
        return Memory(0, problem.path.fit(self.middle.u, problem.grid), 0, spent=(0.0,) * len(problem.budgets))

    @cached_property
    def middle(self) -> Trajectory:
        """The path of these inputs from the problem's own start."""
        problem = self.problem
        return simulate(
            problem.system, problem.x0, np.tile(problem.grid.centre, (problem.steps, 1)), problem.step, tolerance=problem.tolerance
        )

    @property
    def period(self) -> int:
        """Steps per parameter of one input: moved by so many, a path of evenly spread parameters is one of its family again."""
        grid = self.problem.grid
        return max(1, grid.steps * len(grid.names) // max(1, len(self.fresh.p)))

    def now(self, x: np.ndarray, previous: Plan | None, elapsed: int, prior: Prior | ArrayLike | None) -> _Now:
        """Return the problem from x on, so many steps after the previous plan."""
        problem = self.problem
        memory = self.fresh if previous is None else self._moved_on(previous, elapsed)
        steps = max(1, problem.steps - memory.gone) if self.shrinks else problem.steps
        u = self.middle.u if previous is None else previous.trajectory.u[_onward(previous.trajectory.steps, elapsed, steps)]
        path, family, floor = simulate(problem.system, x, u, problem.step, tolerance=problem.tolerance), self._family(memory), problem.floor
        constraints, margins, broken = self._constraints(path, memory)
        changed = replace(
            problem,
            start=x,
            duration=steps * problem.step,
            path=family,
            constraints=constraints,
            budgets=self._budgets(memory),
            floor=None if floor is not None and round(floor.seconds / problem.step) > steps else floor,
            **_knowing(problem, x, prior),
        )
        return _Now(changed, family, memory, path, margins, broken)

    def _family(self, memory: Memory) -> _Moved:
        problem = self.problem
        plain = _Moved(problem.path, problem.steps, memory.by)
        return replace(plain, flown=tuple(memory.p[~plain.live(problem.grid)].tolist()))

    def limits(self, memory: Memory) -> dict[int, _Later]:
        """Return the constraints from now on by their indices, without those whose time is over and those that have been met."""
        gone = memory.gone * self.problem.step if self.shrinks else 0.0
        every = {i: _later(each, gone) for i, each in enumerate(self.problem.constraints) if i not in memory.met}
        return {i: each for i, each in every.items() if each is not None}

    def _constraints(self, path: Trajectory, memory: Memory) -> tuple[tuple[_Later, ...], np.ndarray, tuple[Shortfall, ...]]:
        """Return the limits from now on, their margins at the start of a path, and which of them it is beyond.

        Those must hold again from when the path is back within them: to be less far beyond them nothing else shall be given up.
        """
        kept, broken = list(self.limits(memory).values()), []
        if not kept:
            return (), np.zeros(0), ()
        functions = nodes_of(self.problem.system.model, tuple(kept))
        margins, owner = functions.values(path.x, np.vstack([path.u, path.u[-1:]])), np.array(functions.owner)
        for i, each in enumerate(kept):
            lowest = margins[:, owner == i].min(axis=1, initial=inf)
            if each.when.anywhere or each.when.first != 0.0:
                margins[0, owner == i] = inf
                continue
            if lowest[0] >= 0:
                continue
            size, unit = each.size
            broken.append(Shortfall(str(each), 0.0, float(-lowest[0] * size), unit, float(lowest[0])))
            first, last = (int(np.argmax(lowest >= 0)) or path.steps) * self.problem.step, each.when.last
            kept[i] = replace(each, when=Span(first, last if last is None else max(first, last)))
        return tuple(kept), margins[0], tuple(broken)

    def _budgets(self, memory: Memory) -> tuple[Budget, ...]:
        """Return what is left of each budget; next to nothing of one that is used up."""
        pairs = zip(self.problem.budgets, memory.spent, strict=True)
        return tuple(replace(each, at_most=max(each.at_most - used, 1e-9 * each.at_most)) for each, used in pairs)

    def _moved_on(self, previous: Plan, steps: int) -> Memory:
        """Return a plan's memory so many steps later."""
        problem, memory = self.problem, previous.memory
        rows = None if memory.rows is None else replace(memory.rows, node=memory.rows.node - steps)
        later = replace(memory, gone=memory.gone + steps, by=memory.by + steps, rows=rows)
        if self.shrinks:
            met, totals = self._accounts(previous, steps)
            return replace(later, by=min(later.by, problem.steps - 1), met=met, spent=totals)
        whole = later.by // self.period * self.period
        if not whole:
            return later
        u = _inputs(problem, memory.p)
        return replace(later, by=later.by - whole, p=problem.path.fit(u[_onward(len(u), whole, len(u))], problem.grid))

    def _accounts(self, previous: Plan, steps: int) -> tuple[frozenset[int], tuple[float, ...]]:
        """Return which limits that count once have been met by now, and what is spent of each budget, as it was planned."""
        problem, memory, path = self.problem, previous.memory, previous.trajectory
        flown = min(steps, path.steps)
        if not flown or not (problem.budgets or any(each.span.anywhere for each in problem.constraints)):
            return memory.met, memory.spent
        part = path.part(0, flown)
        totals = np.array(memory.spent) + spent(problem, part, tuple(each.cost for each in problem.budgets))
        fine, met = fine_margins(problem, part), set(memory.met)
        t, owner = memory.gone * problem.step + fine.t, np.array(fine.nodes.owner)
        for i, each in enumerate(problem.constraints):
            first, last = (problem.longest if time is None else time for time in (each.span.first, each.span.last))
            within = (t >= first - 1e-9) & (t <= last + 1e-9)
            if each.span.anywhere and (fine.margins[np.ix_(within, owner == i)].min(axis=1, initial=inf) >= -ALLOWED).any():
                met.add(i)
        return frozenset(met), tuple(totals.tolist())


def _knowing(problem: DesignProblem, x: np.ndarray, prior: Prior | ArrayLike | None) -> dict[str, Any]:
    """Return what of a problem is different with a prior of x (n,): `known`, or the priors of criterion and draws."""
    robust, changes = problem.robust, {}
    information = prior.information if isinstance(prior, Prior) else None if prior is None else as_array("prior", prior)
    if robust is not None:
        covariance = robust.prior.covariance if information is None else _inverse(information)
        changes["robust"] = replace(robust, prior=Prior(x, covariance=covariance))
    if information is not None and isinstance(problem.criterion, Posterior):
        changes["criterion"] = replace(problem.criterion, prior=Prior(x, covariance=_inverse(information)))
    elif information is not None:
        changes["known"] = information
    return changes


def _inverse(information: np.ndarray) -> np.ndarray:
    found = np.linalg.inv(information)
    return (found + found.T) / 2


# ---------------------------------------------------------------- climbs


@dataclass(frozen=True, eq=False)
class _Course:
    """A path under the limits of a problem."""

    problem: DesignProblem
    path: Trajectory

    @cached_property
    def short(self) -> tuple[Shortfall, ...]:
        """What it breaks, worst first."""
        return shortfalls(self.problem, self.path)

    @cached_property
    def objective(self) -> float:
        """What is maximised, recomputed."""
        return objective_of(self.problem, self.path)

    def or_better(self, known: _Course) -> _Course:
        """Return the better one: feasible rather than not, then of higher objective, or of later and less shortfall."""
        if not self.short:
            # looking between the nodes takes longer than the rest: only where it matters
            return self if self.objective >= known.objective or known.short else known
        return self if known.short and self._trouble > known._trouble else known

    @property
    def _trouble(self) -> tuple[float, float]:
        """When it comes, and how bad it is: what is far ahead will be planned again."""
        return min(each.time for each in self.short), self.short[0].margin


@dataclass(frozen=True, eq=False)
class _Seed:
    """Where a climb begins."""

    p: np.ndarray
    rows: Rows
    warm: Warm | None


@dataclass(frozen=True, eq=False)
class _Work:
    """How many climbs within what limits; enough: the relative gain of one after which there is no other."""

    rounds: int
    limits: Limits
    enough: float


@dataclass(frozen=True, eq=False)
class _Found:
    """The best path known, where a next climb would begin, how the climb ended, and seconds per iteration, 0 = none was made."""

    course: _Course
    seed: _Seed | None
    status: Status
    pace: float


def _improved(problem: DesignProblem, known: _Course, seed: _Seed, work: _Work) -> _Found:
    """Climb, look between the nodes, tighten, climb again, until this keeps all limits and gains little more."""
    best, status, done, began, before = known, Status.TIME_LIMIT, 0, perf_counter(), known.objective
    for _ in range(work.rounds):
        if perf_counter() >= work.limits.deadline:
            status = Status.TIME_LIMIT
            break
        solution = climb(Program(problem, seed.rows), aim_of(problem), seed.p, seed.warm, limits=work.limits)
        course = _Course(
            problem, simulate(problem.system, problem.x0, _inputs(problem, solution.p), problem.step, tolerance=problem.tolerance)
        )
        best, status, done = course.or_better(best), solution.status, done + solution.iterations
        # a climb that has not come to terms with its rows yet says nothing about what they leave out
        rows = tightened(problem, course.path, seed.rows) if course.short and solution.violation <= FEASIBLE else None
        warm = solution.warm
        if rows is not None:
            warm = replace(warm, multipliers=warm.multipliers.with_rows(len(seed.rows.node), len(rows.node)))
        seed = _Seed(solution.p, seed.rows if rows is None else rows, warm)
        gained, before = solution.objective - before, solution.objective
        if not course.short and gained <= work.enough * abs(before):
            break
        if rows is None and status is not Status.ITERATION_LIMIT:
            break
    return _Found(best, seed, status, (perf_counter() - began) / done if done else 0.0)


def _inputs(problem: DesignProblem, p: np.ndarray) -> np.ndarray:
    """Return u (N, m) of parameters (q,)."""
    u: Any = problem.path.inputs(p, problem.grid)  # pyright: ignore[reportArgumentType]  # serves both kinds
    return np.asarray(u, dtype=float).reshape(problem.steps, -1)


def _seeded(now: _Now, limits: tuple[int, ...]) -> _Seed:
    """Return where the last climb stopped, its rows and multipliers moved on in time."""
    grid, family, memory, rows = now.problem.grid, now.family, now.memory, rows_of(now.problem)
    p = np.clip(memory.p[family.live(grid)], *family.box(grid))
    # of a limit that is nearer than that, half of what there is
    back = np.clip(now.margins[rows.margin] / 2, 0.0, _BACK)
    old, warm = memory.rows, memory.warm
    if old is None or memory.limits != limits:
        return _Seed(p, replace(rows, allowance=back), warm)
    same = _same(rows, old)
    rows = replace(rows, allowance=np.maximum(np.append(old.allowance, 0.0)[same], back))
    pressed = None if warm is None else warm.multipliers.rows[: len(old.node)]
    kept = _between(old, now.problem.steps, pressed)
    rows, same = rows.with_more(old.of(kept)), np.append(same, kept)
    if warm is None:
        return _Seed(p, rows, None)
    before, count = warm.multipliers, len(old.node)
    moved = np.concatenate([np.append(before.rows[:count], 0.0)[same], before.rows[count:]])
    multipliers = Multipliers(before.matrices, before.floors, moved, before.price)
    return _Seed(p, rows, replace(warm, multipliers=multipliers, radius=max(warm.radius, _RADIUS)))


def _between(old: Rows, steps: int, pressed: np.ndarray | None) -> np.ndarray:
    """Return the indices of old rows between nodes that lie ahead and that the last climb leaned on; without one, of all ahead."""
    single = np.zeros(len(old.node), dtype=bool)
    for choice in old.choices:
        single[choice.rows] = True
    ahead = (old.after > 0) & (old.node >= 0) & (old.node < steps) & ~single
    return np.flatnonzero(ahead if pressed is None else ahead & (pressed > 0))


def _same(rows: Rows, old: Rows) -> np.ndarray:
    """Return for each row the index of the old one at its instant, -1 without one; what counts at one instant only stays the same."""
    shape = [max(each.max(initial=0) for each in pair) + 1 for pair in ((rows.node, old.node), (rows.margin, old.margin))]
    place, single = np.full(shape, -1), np.full(shape[1], -1)
    ahead = np.flatnonzero((old.node >= 0) & (old.after == 0))
    place[old.node[ahead], old.margin[ahead]] = ahead
    at_node = np.flatnonzero(old.after == 0)
    single[old.margin[at_node]] = at_node
    once = np.bincount(rows.margin, minlength=shape[1])[rows.margin] == 1
    return np.where(once, single[rows.margin], np.where(rows.after == 0, place[rows.node, rows.margin], -1))


def _remembered(now: _Now, found: _Found, limits: tuple[int, ...], kept: bool) -> Memory:
    """Return what the next step begins with: where the climb stopped, or the path itself after a climb that failed."""
    grid, family, seed = now.problem.grid, now.family, found.seed
    memory = replace(now.memory, pace=found.pace or _PACE_KEPT * now.memory.pace, limits=limits)
    failed = found.status in (Status.NUMERICAL_ERROR, Status.LOCALLY_INFEASIBLE)
    if seed is None or (kept and failed):
        return replace(memory, p=family.full(family.fit(found.course.path.u, grid), grid), warm=None)
    return replace(memory, p=family.full(seed.p, grid), rows=seed.rows, warm=seed.warm)


def _ended_otherwise(now: _Now, course: _Course, ahead: int) -> _Course:
    """Return what is better than a path that breaks a limit: the path to fall back on with another end, from step `ahead` on."""
    problem, u = now.problem, now.path.u
    if ahead >= len(u):
        return course
    for last in (problem.lower, problem.upper, problem.grid.centre):
        if not course.short:
            break
        course = now.course(np.vstack([u[:ahead], np.tile(last, (len(u) - ahead, 1))])).or_better(course)
    return course


# ---------------------------------------------------------------- the planner


@dataclass(frozen=True, eq=False)
class _Call:
    """The arguments of one step, as they came."""

    x_now: ArrayLike
    previous: Plan | None
    prior: Prior | ArrayLike | None
    deadline: float | None
    elapsed: float | None
    began: float

    def until(self, pace: float) -> float:
        """Return after when no iteration may begin."""
        if self.deadline is None:
            return inf
        if not isinstance(self.deadline, Real) or isnan(self.deadline):
            raise InputError(f"deadline is {self.deadline!r}: must be a number of seconds")
        return self.began + float(self.deadline) - _SPARE * pace - _AFTER


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
    enough: float = ENOUGH
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
        require_count("planner: seed", self.seed, least=0)
        period = self._mission.period // gcd(self._mission.period, self._interval)
        verdict = observability(problem.system, seed=self.seed)
        if verdict.decided and not verdict.observable and not problem.about and not np.any(problem.known):
            raise UnobservableError(verdict)
        plan = self._waiting
        for _ in range(min(_REHEARSED, 2 if self._mission.shrinks else period)):
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
        call, reason = _Call(x_now, previous, prior, deadline, elapsed, perf_counter()), ""
        attempts: tuple[Callable[[_Call], Plan], ...] = (self._planned, self._followed, self._kept, self._waited)
        for attempt in attempts:
            try:
                with one_thread():
                    plan = attempt(call)
                reason = "; ".join(filter(None, (reason, plan.reason)))
                return replace(plan, reason=reason, seconds=perf_counter() - call.began)
            except Exception as error:  # noqa: BLE001  # in flight any plan is better than none; each attempt needs less than the last
                reason = reason or str(error) or type(error).__name__
        return replace(self._waiting, reason=reason, seconds=perf_counter() - call.began)

    # ------------------------------------------------------------ attempts

    def _planned(self, call: _Call) -> Plan:
        """Climb from the previous path, or from several starts."""
        x, previous = as_state(self.problem.system, call.x_now, "x_now"), call.previous
        elapsed = 0 if previous is None else self._elapsed(call)
        now = self._mission.now(x, previous, elapsed, call.prior)
        limits, until, known = tuple(self._mission.limits(now.memory)), call.until(now.memory.pace), _Course(now.problem, now.path)
        if previous is None:
            found, course = self._first(now, known, until), known
        else:
            work = _Work(self.iterations, Limits(1, deadline=until), self.enough)
            found = _improved(now.problem, known, _seeded(now, limits), work)
            course = _ended_otherwise(now, found.course, max(0, previous.trajectory.steps - elapsed))
        kept = found.course is known
        course = found.course if previous is None else course
        age = previous.age + 1 if previous is not None and (kept or course is not found.course) else 0
        return self._plan(now, course, found.status, age, _remembered(now, found, limits, kept))

    def _followed(self, call: _Call) -> Plan:
        """Fly the previous path's inputs from x_now."""
        now, age = self._following(call)
        x = as_state(self.problem.system, call.x_now, "x_now")
        course = _Course(now.problem, simulate(self.problem.system, x, now.path.u, self.problem.step, tolerance=self.problem.tolerance))
        return self._plan(now, course, Status.NUMERICAL_ERROR, age, now.memory)

    def _kept(self, call: _Call) -> Plan:
        """Fly the previous path, x_now being no state."""
        now, age = self._following(call)
        return replace(self._plan(now, _Course(now.problem, now.path), Status.NUMERICAL_ERROR, age, now.memory), feasible=False)

    def _following(self, call: _Call) -> tuple[_Now, int]:
        """Return the problem from where the previous path is now, and its age."""
        previous = call.previous
        if previous is None:
            raise InputError("there is no plan to follow")
        elapsed = self._elapsed(call) if _is_time(call.elapsed) else self._interval
        x = previous.trajectory.x[min(elapsed, previous.trajectory.steps)]
        again = replace(previous, memory=replace(previous.memory, warm=None))
        return self._mission.now(x, again, elapsed, None), previous.age + 1

    def _waited(self, call: _Call) -> Plan:
        """All inputs in the middle of their ranges, from x_now."""
        x = as_state(self.problem.system, call.x_now, "x_now")
        path = simulate(self.problem.system, x, self._mission.middle.u, self.problem.step, tolerance=self.problem.tolerance)
        return replace(self._waiting, trajectory=path, feasible=not shortfalls(self.problem, path))

    @property
    def _waiting(self) -> Plan:
        """The same from the problem's own start, made before anything could go wrong."""
        return Plan(self._mission.middle, nan, Status.NUMERICAL_ERROR, False, "", 0, 0.0, 0.0, self._mission.fresh)

    def _plan(self, now: _Now, course: _Course, status: Status, age: int, memory: Memory) -> Plan:
        wrong = (*now.broken, *course.short)
        # after an error nothing is computed that may be what went wrong
        value = nan if status is Status.NUMERICAL_ERROR else course.objective
        return Plan(
            course.path, value, status, not wrong, "; ".join(map(str, wrong[:3])), age, memory.gone * self.problem.step, 0.0, memory
        )

    def _first(self, now: _Now, known: _Course, until: float) -> _Found:
        """Climb from the most promising starts, coarse families first."""
        plain = self.problem if now.broken else replace(now.problem, constraints=self.problem.constraints)
        best, work = _Found(known, None, Status.TIME_LIMIT, 0.0), _Work(_FIRST_ROUNDS, Limits(TO_THE_END, deadline=until), inf)
        starts = [now.course(u) for _, u in islice(start_inputs(plain, self.seed), self.starts if perf_counter() < until else 0)]
        for start in sorted(starts, key=lambda each: (bool(each.short), -each.objective)):
            if perf_counter() >= until:
                break
            found = _Found(start, None, Status.TIME_LIMIT, 0.0)
            for family in (*families_of(self.problem.path)[:-1], now.family):
                problem = replace(now.problem, path=family)
                seed = _Seed(family.fit(found.course.path.u, problem.grid), rows_of(problem), None)
                found = _improved(problem, found.course, seed, work)
            best = found if found.course.or_better(best.course) is found.course else best
        return best

    # ------------------------------------------------------------ time

    @cached_property
    def _mission(self) -> _Mission:
        return _Mission(self.problem, self.horizon == "shrinking")

    @property
    def _interval(self) -> int:
        """Steps from one plan to the next."""
        every = self.problem.step if self.every is None else self.every
        found = whole_multiple(every, self.problem.step) if _is_time(every) and every else None
        if found is None:
            raise InputError(f"planner: every is {every!r}: must be a whole multiple of the step {self.problem.step:g} s")
        return found

    def _elapsed(self, call: _Call) -> int:
        """Steps since the previous plan."""
        if call.elapsed is None:
            return self._interval
        if not _is_time(call.elapsed):
            raise InputError(f"elapsed is {call.elapsed!r}: must be a finite number of seconds, at least 0")
        return round(call.elapsed / self.problem.step)


def _is_time(value: object) -> bool:
    return isinstance(value, (int, float)) and isfinite(value) and value >= 0
