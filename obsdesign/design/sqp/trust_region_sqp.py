"""Sequential quadratic programming to a local optimum: convex models in a trust region, limits by an exact penalty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from logging import getLogger
from time import perf_counter

import numpy as np

from obsdesign.design.sqp.local_model import FEASIBILITY_TOLERANCE, bounds_of, build_model, multipliers_of, solve_model
from obsdesign.design.sqp.matrix_objective import AbstractMatrixObjective
from obsdesign.design.sqp.merit import Iterate, MeritFunction
from obsdesign.design.sqp.nonlinear_program import AnyProgram
from obsdesign.design.sqp.penalty import MAX_PENALTY, raise_penalty, steer_penalty, update_scaling
from obsdesign.design.sqp.solver_state import SolverState, WarmStart, initial_state
from obsdesign.design.sqp.trial_step import best_trial, escape_saddle
from obsdesign.status import Status

_LOGGER = getLogger(__name__)
MAX_ITERATIONS = 150  # work, not seconds, decides when a solve is given up
TOLERANCE = 1e-8  # reduction that a model must predict, in units of the merit
_MAX_RADIUS, _MIN_RADIUS = 1.0, 1e-9  # of the trust region, in widths of the box
_STATIONARITY_TOLERANCE, _VIOLATION_TOLERANCE = 1e-6, 1e-6
_PACE, _AHEAD = 8, 5.0  # iterations over which the pace of a climb is taken, and how many times as many it is granted at that pace
_NEARLY_FEASIBLE = 0.02  # violation up to which an objective says how a climb goes: before, it is given up for the limits
_CEILING_SHARE = 1e-7  # of what no objective exceeds, below which nothing is left to be gained
_MAX_VIOLATION = 1e-4  # that counts as none, of a solve that need not be exact
_COLLAPSED_RADIUS, _STATIONARY_RESIDUAL = 1e-4, 0.1  # radius, and residual, of a region that has shrunk


@dataclass(frozen=True, eq=False)
class StoppingCriteria:
    """When a solve ends without an answer: iterations, and a deadline of time.perf_counter; tolerance: when it has one.

    target: objective below which an answer is worth nothing: what would stay below at five times the gain of its last 8 iterations ends.
    ceiling: what no objective exceeds: a climb that is within 1e-7 of it, relative, has ended.
    """

    iterations: int = MAX_ITERATIONS
    tolerance: float = TOLERANCE
    deadline: float = float("inf")
    target: float = float("-inf")
    ceiling: float = float("inf")


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a solve stopped.

    objective: of the matrices, minus price; violation: the largest of a row or floor.
    """

    p: np.ndarray
    objective: float
    violation: float
    status: Status
    iterations: int
    warm_start: WarmStart
    compute_residual: Callable[[], float]

    @cached_property
    def residual(self) -> float:
        """The largest entry of the projected gradient of the Lagrangian times the width of the box, in units of the objective."""
        return self.compute_residual()


@dataclass(frozen=True, eq=False)
class _StepOutcome:
    """What one iteration came to: the state, whether its iterate is better, and the reduction that its model predicted."""

    state: SolverState
    is_better: bool
    predicted_reduction: float
    is_solved: bool


def solve(
    program: AnyProgram,
    objective: AbstractMatrixObjective,
    p: np.ndarray,
    warm_start: WarmStart | None = None,
    eigenvalue_floor: float = 0.0,
    stopping: StoppingCriteria | None = None,
) -> Solution:
    """Maximise objective minus price from parameters p (q,); eigenvalue_floor: keep lambda_min of every judged matrix at or above this.

    After the deadline the best point so far is returned as TIME_LIMIT.
    Source: sequential quadratic programming with a trust region and an exact penalty (Fletcher, 1985), its models with matrix
    inequalities where the objective is a smallest eigenvalue (Fares, Noll, Apkarian, 2002).
    """
    merit_function, stopping = MeritFunction(program, objective, eigenvalue_floor), StoppingCriteria() if stopping is None else stopping
    state, status, iterations = initial_state(merit_function, p, warm_start), Status.ITERATION_LIMIT, 0
    if not np.isfinite(state.iterate.merit):
        return _solution(merit_function, state, Status.NUMERICAL_ERROR, 0)
    objectives: list[float] = []
    while iterations < stopping.iterations:
        if perf_counter() >= stopping.deadline:
            status = Status.TIME_LIMIT
            break
        iterations += 1
        outcome = _take_step(merit_function, state, stopping.tolerance)
        state = outcome.state
        iterate = state.iterate
        _LOGGER.debug("iteration %d: merit %.9g, violation %.2g, radius %.2g", iterations, iterate.merit, iterate.violation, state.radius)
        if not outcome.is_better:
            if state.iterate.violation > _violation_tolerance(stopping.tolerance) and state.scaling.penalty < MAX_PENALTY:
                state = raise_penalty(merit_function, state)
                continue
            status = _final_status(merit_function, outcome, stopping.tolerance)
            break
        if iterate.violation <= _NEARLY_FEASIBLE:
            objectives.append(iterate.objective_value - iterate.evaluation.price)
        if iterate.violation <= FEASIBILITY_TOLERANCE and _reaches(iterate, stopping.ceiling):
            status = Status.LOCALLY_OPTIMAL
            break
        if _is_hopeless(objectives, stopping.target):
            status = Status.ABANDONED
            break
        state = update_scaling(merit_function, state)
    return _solution(merit_function, state, status, iterations)


# ---------------------------------------------------------------- one iteration


def _take_step(merit_function: MeritFunction, state: SolverState, tolerance: float) -> _StepOutcome:
    """Build a model and solve it in ever smaller regions until a step reduces the merit."""
    derivatives = merit_function.program.derivatives(state.iterate.evaluation) if state.derivatives is None else state.derivatives
    model = build_model(merit_function, state.iterate, derivatives, state.multipliers, state.at_bound, state.scaling)
    state = replace(state, derivatives=derivatives)
    predicted_reduction, is_solved, is_refused = np.inf, False, False
    while state.radius > _MIN_RADIUS:
        solution = solve_model(model, state.scaling, state.radius)
        if solution is None:
            state = replace(state, radius=state.radius / 4)
            continue
        scaling, solution = steer_penalty(model, solution, state.scaling, state.radius)
        iterate = merit_function.rescale(state.iterate, scaling)
        state = replace(state, iterate=iterate, scaling=scaling, multipliers=multipliers_of(model, solution, scaling))
        model = replace(model, iterate=iterate)
        at_bound = bounds_of(model, solution, state.radius)
        predicted_reduction, is_solved = iterate.merit - solution.predicted_merit, True
        if predicted_reduction <= tolerance * max(1.0, abs(iterate.merit)):
            escape = escape_saddle(model, scaling, state.radius, tolerance)
            if escape is None:
                break
            return _StepOutcome(replace(state, iterate=escape, at_bound=at_bound, derivatives=None), True, predicted_reduction, True)
        trial = best_trial(model, solution, scaling, state.radius, predicted_reduction)
        actual_reduction, step_length = iterate.merit - trial.merit, float(np.max(np.abs(solution.d) / merit_function.width))
        if actual_reduction > 0.05 * predicted_reduction:
            radius = _next_radius(state.radius, step_length, actual_reduction / predicted_reduction)
            accepted = replace(state, iterate=trial, at_bound=at_bound, radius=radius, derivatives=None)
            return _StepOutcome(accepted, True, predicted_reduction, True)
        state = replace(state, radius=0.35 * min(step_length, state.radius))
        if not is_refused:  # multipliers that the refused step has shown say how limits bend that were not active before
            model = build_model(merit_function, state.iterate, derivatives, state.multipliers, at_bound, state.scaling)
        is_refused = True
    return _StepOutcome(state, False, predicted_reduction, is_solved)


def _next_radius(radius: float, step_length: float, reduction_ratio: float) -> float:
    if reduction_ratio > 0.7 and step_length > 0.8 * radius:
        return min(_MAX_RADIUS, 2.5 * radius)
    return 0.5 * step_length if reduction_ratio < 0.3 else radius


# ---------------------------------------------------------------- the end


def _reaches(iterate: Iterate, ceiling: float) -> bool:
    return iterate.objective_value - iterate.evaluation.price >= ceiling - _CEILING_SHARE * abs(ceiling)


def _is_hopeless(objectives: list[float], target: float) -> bool:
    """Whether objectives of one iterate after the other, at five times the gain of the last 8, stay below the one that is wanted."""
    return len(objectives) > _PACE and objectives[-1] + _AHEAD * max(0.0, objectives[-1] - objectives[-1 - _PACE]) < target


def _violation_tolerance(tolerance: float) -> float:
    return max(_VIOLATION_TOLERANCE, min(10 * tolerance, _MAX_VIOLATION))


def _final_status(merit_function: MeritFunction, outcome: _StepOutcome, tolerance: float) -> Status:
    """Say what it means that nothing better is near."""
    iterate = outcome.state.iterate
    # a small prediction says little where the region has shrunk: the gradient must say so too
    is_trusted = outcome.state.radius > _COLLAPSED_RADIUS or _residual(merit_function, outcome.state) <= _STATIONARY_RESIDUAL
    is_stationary = (
        outcome.is_solved
        and is_trusted
        and outcome.predicted_reduction <= max(_STATIONARITY_TOLERANCE, tolerance) * max(1.0, abs(iterate.merit))
    )
    if iterate.violation > _violation_tolerance(tolerance):
        return Status.LOCALLY_INFEASIBLE if is_stationary or outcome.state.scaling.penalty >= MAX_PENALTY else Status.NUMERICAL_ERROR
    return Status.LOCALLY_OPTIMAL if is_stationary else Status.NUMERICAL_ERROR


def _solution(merit_function: MeritFunction, state: SolverState, status: Status, iterations: int) -> Solution:
    iterate = state.iterate
    warm_start = WarmStart(state.multipliers, min(state.scaling.penalty, 100.0), max(state.radius, 1e-3))
    objective = iterate.objective_value - iterate.evaluation.price
    return Solution(
        iterate.evaluation.p, objective, iterate.violation, status, iterations, warm_start, partial(_residual, merit_function, state)
    )


def _residual(merit_function: MeritFunction, state: SolverState) -> float:
    if not np.isfinite(state.iterate.merit):
        return float("nan")
    evaluation, multipliers, program = state.iterate.evaluation, state.multipliers, merit_function.program
    derivatives = program.derivatives(evaluation) if state.derivatives is None else state.derivatives
    g = multipliers.price * derivatives.price - np.einsum("bij,bqij->q", multipliers.matrices, derivatives.matrices)
    g -= np.einsum("bij,bqij->q", multipliers.floors, derivatives.floors) + multipliers.rows @ derivatives.rows
    width = merit_function.width
    projected = np.clip(evaluation.p / width - g * width, program.lower / width, program.upper / width)
    return float(np.abs(projected - evaluation.p / width).max(initial=0.0))
