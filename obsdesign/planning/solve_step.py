"""The solves of one step of the planner, each path that they come to checked between the nodes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import repeat
from math import inf
from time import perf_counter

import numpy as np

from obsdesign.design.checked_path import CheckedPath
from obsdesign.design.feasibility import initial_rows
from obsdesign.design.nlp.criterion_objective import matrix_objective_of
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.local_model import FEASIBILITY_TOLERANCE
from obsdesign.design.sqp.trust_region_sqp import MAX_ITERATIONS, Solution, StoppingCriteria
from obsdesign.design.tightening import SolveStart, solve_rounds
from obsdesign.paths.abstract import AbstractPath
from obsdesign.planning.remaining_problem import RemainingProblem
from obsdesign.status import Status

_FIRST_ROUNDS = 8  # of solving again with tighter rows, in the first step
_ALLOWANCE_FACTOR = 1.1  # by how many times a shortfall what is asked for already is raised


@dataclass(frozen=True, eq=False)
class SolveLimits:
    """How many solves within what limits; min_gain: the relative gain of one after which there is no other."""

    rounds: int
    stopping: StoppingCriteria
    min_gain: float


@dataclass(frozen=True, eq=False)
class SolveResult:
    """The best path known, where a next solve would begin, how the solve ended, and seconds per iteration, 0 = none was made."""

    checked: CheckedPath
    next_start: SolveStart | None
    status: Status
    iteration_seconds: float


def solve_and_check(problem: DesignProblem, fallback: CheckedPath, start: SolveStart, limits: SolveLimits) -> SolveResult:
    """Solve, look between the nodes, tighten, solve again, until this keeps all limits and gains little more."""
    rounds = solve_rounds(
        problem, matrix_objective_of(problem), start, repeat(_ALLOWANCE_FACTOR), _is_worth_tightening, stopping=limits.stopping
    )
    best, status, iterations, start_time, before = fallback, Status.TIME_LIMIT, 0, perf_counter(), fallback.objective
    for _ in range(limits.rounds):
        if perf_counter() >= limits.stopping.deadline:
            status = Status.TIME_LIMIT
            break
        latest = next(rounds)
        solution, start = latest.solution, latest.next_start
        best, status, iterations = latest.checked.better_of(best), solution.status, iterations + solution.iterations
        gain, before = solution.objective - before, solution.objective
        if not latest.checked.violations and gain <= limits.min_gain * abs(before):
            break
        if not latest.is_tightened and status is not Status.ITERATION_LIMIT:
            break
    return SolveResult(best, start, status, (perf_counter() - start_time) / iterations if iterations else 0.0)


def _is_worth_tightening(solution: Solution, checked: CheckedPath) -> bool:
    """Whether a path breaks limits; a solve that has not come to terms with its rows yet says nothing about what they leave out."""
    return bool(checked.violations) and solution.violation <= FEASIBILITY_TOLERANCE


def solve_from_guesses(
    remaining: RemainingProblem,
    fallback: CheckedPath,
    guesses: Iterable[np.ndarray],
    coarse_families: tuple[AbstractPath, ...],
    deadline: float,
) -> SolveResult:
    """Solve from the inputs (N, m) of every guess, the most promising first, coarse families before the problem's own.

    Returns the best of what they came to and of the path to fall back on.
    """
    limits = SolveLimits(_FIRST_ROUNDS, StoppingCriteria(MAX_ITERATIONS, deadline=deadline), inf)
    best = SolveResult(fallback, None, Status.TIME_LIMIT, 0.0)
    starts = [remaining.checked_path(u) for u in guesses]
    for start in sorted(starts, key=lambda checked: (bool(checked.violations), -checked.objective)):
        if perf_counter() >= deadline:
            break
        result = SolveResult(start, None, Status.TIME_LIMIT, 0.0)
        for family in (*coarse_families, remaining.family):
            problem = replace(remaining.problem, path=family)
            solve_start = SolveStart(family.fit(result.checked.path.u, problem.grid), initial_rows(problem))
            result = solve_and_check(problem, result.checked, solve_start, limits)
        best = result if result.checked.better_of(best.checked) is result.checked else best
    return best


def try_other_ends(remaining: RemainingProblem, checked: CheckedPath, from_step: int) -> CheckedPath:
    """Return what is better than a path that breaks a limit: the path to fall back on with another end, from step `from_step` on."""
    problem, u = remaining.problem, remaining.path.u
    if from_step >= len(u):
        return checked
    for last in (problem.lower, problem.upper, problem.grid.centre):
        if not checked.violations:
            break
        checked = remaining.checked_path(np.vstack([u[:from_step], np.tile(last, (len(u) - from_step, 1))])).better_of(checked)
    return checked
