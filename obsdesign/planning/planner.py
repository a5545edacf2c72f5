"""Receding horizon: the same problem, solved again and again from where the vehicle is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from math import gcd, inf, isfinite, isnan, nan
from numbers import Real
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.analysis.query import observability
from obsdesign.analysis.verdict import UnobservableError
from obsdesign.arguments import validate_arguments
from obsdesign.blas_threads import one_thread
from obsdesign.checks import require_count, require_positive, whole_multiple
from obsdesign.design.checked_path import CheckedPath
from obsdesign.design.feasibility import violations
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import families_of
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.trust_region_sqp import StoppingCriteria
from obsdesign.dynamics.simulation import as_state, simulate
from obsdesign.errors import InputError
from obsdesign.planning.plan import Memory, Plan
from obsdesign.planning.remaining_problem import MovingHorizon, RemainingProblem
from obsdesign.planning.shifted_path import Horizon
from obsdesign.planning.solve_step import SolveLimits, solve_and_check, solve_from_guesses, try_other_ends
from obsdesign.planning.warm_start import next_memory, shifted_warm_start
from obsdesign.prior import Prior
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

ITERATIONS, MIN_GAIN = 4, 5e-2  # of a warm step at most; relative gain of one after which there is no other

_SPARE_ITERATIONS, _CHECK_SECONDS = 1.5, 0.015  # left unused before a deadline: iterations' worth of time, and seconds for the check
_REHEARSAL_STEPS = 8  # steps at most that are taken at construction


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
                memory's `iteration_seconds` apart.
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
            # in flight any plan is better than none, whatever went wrong: what it was is the plan's reason, and each attempt
            # computes less than the one before
            except Exception as error:  # noqa: BLE001
                reason = reason or str(error) or type(error).__name__
        return replace(self._fallback_plan, reason=reason, seconds=perf_counter() - arguments.start_time)

    def _solve(self, arguments: StepArguments) -> Plan:
        """Solve from the previous path, or from several guesses."""
        x, previous = as_state(self.problem.system, arguments.x_now, "x_now"), arguments.previous
        elapsed = 0 if previous is None else self._elapsed_steps(arguments)
        remaining = self._moving_horizon.remaining_problem(x, previous, elapsed, arguments.prior)
        constraint_indices, deadline, fallback = (
            tuple(self._moving_horizon.remaining_constraints(remaining.memory)),
            arguments.latest_start(remaining.memory.iteration_seconds),
            CheckedPath(remaining.problem, remaining.path),
        )
        if previous is None:
            guesses = self._guesses(remaining, deadline)
            result = solve_from_guesses(remaining, fallback, guesses, families_of(self.problem.path)[:-1], deadline)
            checked, age = result.checked, 0
        else:
            limits = SolveLimits(self.iterations, StoppingCriteria(1, deadline=deadline), self.enough)
            result = solve_and_check(remaining.problem, fallback, shifted_warm_start(remaining, constraint_indices), limits)
            checked = try_other_ends(remaining, result.checked, max(0, previous.trajectory.steps - elapsed))
            age = previous.age + 1 if result.checked is fallback or checked is not result.checked else 0
        memory = next_memory(remaining, result, constraint_indices, is_fallback=result.checked is fallback)
        return self._build_plan(remaining, checked, result.status, age, memory)

    def _guesses(self, remaining: RemainingProblem, deadline: float) -> Iterator[np.ndarray]:
        """Return the inputs of the first step's guesses; none where the time is over before they are made."""
        problem = self.problem if remaining.violated else replace(remaining.problem, constraints=self.problem.constraints)
        count = self.starts if perf_counter() < deadline else 0
        return (u for _, u in islice(start_inputs(problem, self.seed), count))

    def _follow_inputs(self, arguments: StepArguments) -> Plan:
        """Fly the previous path's inputs from x_now."""
        remaining, age = self._previous_problem(arguments)
        x = as_state(self.problem.system, arguments.x_now, "x_now")
        checked = CheckedPath(remaining.problem, self._simulate(x, remaining.path.u))
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
        path = self._simulate(x, self._moving_horizon.mid_range_path.u)
        return replace(self._fallback_plan, trajectory=path, feasible=not violations(self.problem, path))

    @property
    def _fallback_plan(self) -> Plan:
        """The same from the problem's own start, made before anything could go wrong."""
        horizon = self._moving_horizon
        return Plan(horizon.mid_range_path, nan, Status.NUMERICAL_ERROR, False, "", 0, 0.0, 0.0, horizon.initial_memory)

    def _simulate(self, x: np.ndarray, u: np.ndarray) -> Trajectory:
        return simulate(self.problem.system, x, u, self.problem.step, tolerance=self.problem.tolerance)

    def _build_plan(self, remaining: RemainingProblem, checked: CheckedPath, status: Status, age: int, memory: Memory) -> Plan:
        all_violations = (*remaining.violated, *checked.violations)
        # after an error nothing is computed that may be what went wrong
        value = nan if status is Status.NUMERICAL_ERROR else checked.objective
        reason, time = "; ".join(map(str, all_violations[:3])), memory.elapsed_steps * self.problem.step
        return Plan(checked.path, value, status, not all_violations, reason, age, time, 0.0, memory)

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
