"""Climbing to a local optimum: convex models in a trust region, limits by an exact penalty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from time import perf_counter

import numpy as np

from obsdesign.design.sqp.evaluation import AbstractDerivatives, AbstractEvaluation, Multipliers
from obsdesign.design.sqp.local_model import (
    FEASIBILITY_TOLERANCE,
    LocalModel,
    ModelSolution,
    active_set_step,
    build_model,
    multipliers_of,
    second_order_correction,
    slack_at_weight,
    solve_model,
)
from obsdesign.design.sqp.matrix_objective import AbstractMatrixObjective, initial_weights
from obsdesign.design.sqp.merit import Iterate, MeritFunction, MeritScaling
from obsdesign.design.sqp.nonlinear_program import AnyProgram
from obsdesign.status import Status

MAX_ITERATIONS = 150  # work, not seconds, decides when a climb is given up
TOLERANCE = 1e-8  # improvement that a model must promise, in units of the merit
_INITIAL_RADIUS, _MAX_RADIUS, _MIN_RADIUS = 0.3, 1.0, 1e-9  # of the trust region, in widths of the box
_INITIAL_PENALTY, _MAX_PENALTY, _MAX_RELAXATIONS = 1.0, 1e6, 6
_STATIONARITY_TOLERANCE, _VIOLATION_TOLERANCE = 1e-6, 1e-6
_COLLAPSED_RADIUS, _STATIONARY_RESIDUAL = 1e-4, 0.1  # radius, and residual, of a region that has shrunk


@dataclass(frozen=True, eq=False)
class WarmStart:
    """Where a climb may begin beside its parameters: multipliers, penalty and radius of another one."""

    multipliers: Multipliers
    penalty: float = _INITIAL_PENALTY
    radius: float = _INITIAL_RADIUS


@dataclass(frozen=True, eq=False)
class StoppingCriteria:
    """When a climb ends without an answer: iterations, and a deadline of time.perf_counter; tolerance: when it has one."""

    iterations: int = MAX_ITERATIONS
    tolerance: float = TOLERANCE
    deadline: float = float("inf")


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a climb stopped.

    objective: aim minus price by the program; violation: the largest shortfall of a margin.
    """

    p: np.ndarray
    objective: float
    violation: float
    status: Status
    iterations: int
    warm_start: WarmStart
    slope: Callable[[], float]

    @cached_property
    def residual(self) -> float:
        """The largest entry of the projected gradient of the Lagrangian times the width of the box, in units of the aim."""
        return self.slope()


@dataclass(frozen=True, eq=False)
class _SolverState:
    """Everything that one iteration hands to the next.

    at_bound (q,): parameters on their bounds; relaxations: times the penalty fell; slopes: at the place, None where they are not known yet.
    """

    iterate: Iterate
    multipliers: Multipliers
    scaling: MeritScaling
    radius: float
    at_bound: np.ndarray
    relaxations: int = 0
    slopes: AbstractDerivatives | None = None


@dataclass(frozen=True, eq=False)
class _StepOutcome:
    """What one iteration came to: the state, whether it is a better place, and what its model promised."""

    state: _SolverState
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
    """Maximise aim minus price from parameters p (q,); eigenvalue_floor: keep lambda_min of every judged matrix at or above this.

    After the deadline the best point so far is returned as TIME_LIMIT.
    Source: sequential quadratic programming with a trust region and an exact penalty (Fletcher, 1985), its models with matrix
    inequalities where the aim is a smallest eigenvalue (Fares, Noll, Apkarian, 2002).
    """
    merit_function, stopping = MeritFunction(program, objective, eigenvalue_floor), StoppingCriteria() if stopping is None else stopping
    state, status, iterations = _initial_state(merit_function, p, warm_start), Status.ITERATION_LIMIT, 0
    if not np.isfinite(state.iterate.merit):
        return _solution(merit_function, state, Status.NUMERICAL_ERROR, 0)
    while iterations < stopping.iterations:
        if perf_counter() >= stopping.deadline:
            status = Status.TIME_LIMIT
            break
        iterations += 1
        outcome = _take_step(merit_function, state, stopping.tolerance)
        state = outcome.state
        if not outcome.is_better:
            if state.iterate.violation > _VIOLATION_TOLERANCE and state.scaling.penalty < _MAX_PENALTY:
                state = _raise_penalty(merit_function, state)
                continue
            status = _final_status(merit_function, outcome, stopping.tolerance)
            break
        state = _update_scaling(merit_function, state)
    return _solution(merit_function, state, status, iterations)


def _initial_state(merit_function: MeritFunction, p: np.ndarray, warm_start: WarmStart | None) -> _SolverState:
    evaluation = merit_function.program.evaluate(np.clip(p, merit_function.program.lower, merit_function.program.upper))
    scaling = MeritScaling(
        merit_function.objective.unit(evaluation.matrices), _INITIAL_PENALTY if warm_start is None else warm_start.penalty
    )
    multipliers = _initial_multipliers(merit_function, evaluation, scaling)
    if warm_start is not None:
        multipliers = _reuse_multipliers(warm_start.multipliers, multipliers)
    radius = _INITIAL_RADIUS if warm_start is None else warm_start.radius
    return _SolverState(merit_function.assess(evaluation, scaling), multipliers, scaling, radius, np.zeros(len(p), dtype=bool))


def _initial_multipliers(merit_function: MeritFunction, evaluation: AbstractEvaluation, scaling: MeritScaling) -> Multipliers:
    """Multipliers before any model was solved: the aim's slope, and nothing for limits."""
    weights = initial_weights(merit_function.objective, evaluation.matrices) / scaling.unit
    Z = np.nan_to_num(merit_function.objective.gradients(evaluation.matrices) * weights[:, None, None])
    return Multipliers(Z, np.zeros_like(evaluation.floors), np.zeros(len(evaluation.rows)), 1 / scaling.unit)


def _reuse_multipliers(previous: Multipliers, initial: Multipliers) -> Multipliers:
    """Another climb's multipliers, where they are as many."""
    pairs = ((previous.matrices, initial.matrices), (previous.floors, initial.floors), (previous.rows, initial.rows))
    matrices, floors, rows = (reused if reused.shape == fallback.shape else fallback for reused, fallback in pairs)
    return Multipliers(matrices, floors, rows, initial.price)


# ---------------------------------------------------------------- one iteration


def _take_step(merit_function: MeritFunction, state: _SolverState, tolerance: float) -> _StepOutcome:
    """Make a model and solve it in ever smaller regions until a step is a gain."""
    slopes = merit_function.program.derivatives(state.iterate.evaluation) if state.slopes is None else state.slopes
    model, state = (
        build_model(merit_function, state.iterate, slopes, state.multipliers, state.at_bound, state.scaling),
        replace(state, slopes=slopes),
    )
    predicted_reduction, is_solved = np.inf, False
    while state.radius > _MIN_RADIUS:
        solution = solve_model(model, state.scaling, state.radius)
        if solution is None:
            state = replace(state, radius=state.radius / 4)
            continue
        scaling, solution = _steer_penalty(model, solution, state.scaling, state.radius)
        iterate = merit_function.rescale(state.iterate, scaling)
        state, model = (
            replace(state, iterate=iterate, scaling=scaling, multipliers=multipliers_of(model, solution, scaling)),
            replace(model, iterate=iterate),
        )
        predicted_reduction, is_solved = iterate.merit - solution.predicted_merit, True
        if predicted_reduction <= tolerance * max(1.0, abs(iterate.merit)):
            escape = _escape_saddle(model, scaling, state.radius, tolerance)
            if escape is None:
                break
            return _StepOutcome(
                replace(state, iterate=escape, at_bound=solution.qp_solution.bound_multipliers > _STATIONARITY_TOLERANCE, slopes=None),
                True,
                predicted_reduction,
                True,
            )
        trial = _best_trial(model, solution, scaling, state.radius, predicted_reduction)
        actual_reduction, step_length = iterate.merit - trial.merit, float(np.max(np.abs(solution.d) / merit_function.width))
        if actual_reduction > 0.05 * predicted_reduction:
            at_bound = solution.qp_solution.bound_multipliers > _STATIONARITY_TOLERANCE
            radius = _next_radius(state.radius, step_length, actual_reduction / predicted_reduction)
            return _StepOutcome(
                replace(state, iterate=trial, at_bound=at_bound, radius=radius, slopes=None), True, predicted_reduction, True
            )
        state = replace(state, radius=0.35 * min(step_length, state.radius))
    return _StepOutcome(state, False, predicted_reduction, is_solved)


def _steer_penalty(model: LocalModel, solution: ModelSolution, scaling: MeritScaling, radius: float) -> tuple[MeritScaling, ModelSolution]:
    """Raise the penalty where the aim is what keeps the model from being more feasible (Byrd, Nocedal, Waltz, 2008)."""
    while solution.qp_solution.slack > FEASIBILITY_TOLERANCE / 10 and scaling.penalty < _MAX_PENALTY:
        if slack_at_weight(model, solution, scaling, radius, 0.1) > 0.8 * solution.qp_solution.slack:
            break
        raised_scaling = replace(scaling, penalty=10 * scaling.penalty)
        raised_solution = solve_model(model, raised_scaling, radius)
        if raised_solution is None:
            break
        scaling, solution = raised_scaling, raised_solution
    return scaling, solution


def _best_trial(model: LocalModel, solution: ModelSolution, scaling: MeritScaling, radius: float, predicted_reduction: float) -> Iterate:
    """Return the best place of the step, its correction for curved limits, its continuation, and Newton's step near the end."""
    merit_function, iterate = model.merit_function, model.iterate
    p = iterate.evaluation.p
    best = merit_function.evaluate(p + solution.d, scaling)
    if iterate.merit - best.merit < 0.25 * predicted_reduction and np.isfinite(best.merit):
        d = second_order_correction(model, solution, best, scaling, radius)
        best = best if d is None else min(best, merit_function.evaluate(p + d, scaling), key=_merit)
    factor = 2.0
    while iterate.merit - best.merit > 1.3 * predicted_reduction and factor <= 16:
        extrapolated = merit_function.evaluate(p + factor * solution.d, scaling)
        if not extrapolated.merit < best.merit:
            break
        best, factor = extrapolated, 2 * factor
    if np.max(np.abs(solution.d) / merit_function.width) < 0.5 * radius and predicted_reduction < 1e-2 * max(1.0, abs(iterate.merit)):
        d = active_set_step(model, solution, scaling, radius)
        best = best if d is None else min(best, merit_function.evaluate(p + d, scaling), key=_merit)
    return best


def _escape_saddle(model: LocalModel, scaling: MeritScaling, radius: float, tolerance: float) -> Iterate | None:
    """Return a better place along the most negative curvature, where slopes promise nothing: a saddle is no optimum."""
    if model.negative_curvature is None:
        return None
    merit_function, iterate = model.merit_function, model.iterate
    for share in (1.0, 0.25, 0.05):
        trials = [
            merit_function.evaluate(iterate.evaluation.p + sign * share * radius * model.negative_curvature, scaling) for sign in (1, -1)
        ]
        best = min(trials, key=_merit)
        if iterate.merit - best.merit > 10 * tolerance * max(1.0, abs(iterate.merit)):
            return best
    return None


def _merit(iterate: Iterate) -> float:
    return iterate.merit


def _next_radius(radius: float, step_length: float, reduction_ratio: float) -> float:
    if reduction_ratio > 0.7 and step_length > 0.8 * radius:
        return min(_MAX_RADIUS, 2.5 * radius)
    return 0.5 * step_length if reduction_ratio < 0.3 else radius


def _raise_penalty(merit_function: MeritFunction, state: _SolverState) -> _SolverState:
    """Return the state with a higher penalty: where nothing better is near for this one, limits may still be met for another."""
    scaling = replace(state.scaling, penalty=10 * state.scaling.penalty)
    return replace(
        state, iterate=merit_function.rescale(state.iterate, scaling), scaling=scaling, radius=max(state.radius, _INITIAL_RADIUS)
    )


def _update_scaling(merit_function: MeritFunction, state: _SolverState) -> _SolverState:
    """Return the state in terms that suit where it is: a lower penalty once all limits hold, a unit near the aim."""
    scaling, relaxations = state.scaling, state.relaxations
    exact_penalty = max(_INITIAL_PENALTY, 3 * _slack_price(merit_function, state.multipliers))
    if state.iterate.violation <= FEASIBILITY_TOLERANCE and relaxations < _MAX_RELAXATIONS and exact_penalty < scaling.penalty / 3:
        scaling, relaxations = replace(scaling, penalty=exact_penalty), relaxations + 1
    unit = merit_function.objective.unit(state.iterate.evaluation.matrices)
    if not scaling.unit / 3 <= unit <= 3 * scaling.unit:
        scaling = replace(scaling, unit=unit)
    if scaling is state.scaling:
        return state
    multipliers = state.multipliers.scale(state.scaling.unit / scaling.unit)
    return replace(
        state, iterate=merit_function.rescale(state.iterate, scaling), scaling=scaling, multipliers=multipliers, relaxations=relaxations
    )


def _slack_price(merit_function: MeritFunction, multipliers: Multipliers) -> float:
    """What all limits together would pay for slack: a penalty above it is exact."""
    floor_price = merit_function.program.floor_level * float(np.trace(multipliers.floors, axis1=1, axis2=2).sum())
    eigenvalue_price = (
        merit_function.eigenvalue_floor * float(np.trace(multipliers.matrices, axis1=1, axis2=2).sum())
        if merit_function.eigenvalue_floor
        else 0.0
    )
    return float(multipliers.rows.sum()) + floor_price + eigenvalue_price


# ---------------------------------------------------------------- the end


def _final_status(merit_function: MeritFunction, outcome: _StepOutcome, tolerance: float) -> Status:
    """Say what it means that nothing better is near."""
    iterate = outcome.state.iterate
    # a promise is worth little where the region has shrunk: the slopes must say so too
    is_trusted = outcome.state.radius > _COLLAPSED_RADIUS or _residual(merit_function, outcome.state) <= _STATIONARY_RESIDUAL
    is_stationary = (
        outcome.is_solved
        and is_trusted
        and outcome.predicted_reduction <= max(_STATIONARITY_TOLERANCE, tolerance) * max(1.0, abs(iterate.merit))
    )
    if iterate.violation > max(_VIOLATION_TOLERANCE, 10 * tolerance):
        return Status.LOCALLY_INFEASIBLE if is_stationary or outcome.state.scaling.penalty >= _MAX_PENALTY else Status.NUMERICAL_ERROR
    return Status.LOCALLY_OPTIMAL if is_stationary else Status.NUMERICAL_ERROR


def _solution(merit_function: MeritFunction, state: _SolverState, status: Status, iterations: int) -> Solution:
    iterate = state.iterate
    warm_start = WarmStart(state.multipliers, min(state.scaling.penalty, 100.0), max(state.radius, 1e-3))
    objective = iterate.objective_value - iterate.evaluation.price
    return Solution(
        iterate.evaluation.p, objective, iterate.violation, status, iterations, warm_start, partial(_residual, merit_function, state)
    )


def _residual(merit_function: MeritFunction, state: _SolverState) -> float:
    if not np.isfinite(state.iterate.merit):
        return float("nan")
    evaluation, multipliers, program = state.iterate.evaluation, state.multipliers, merit_function.program
    derivatives = program.derivatives(evaluation) if state.slopes is None else state.slopes
    g = multipliers.price * derivatives.price - np.einsum("bij,bqij->q", multipliers.matrices, derivatives.matrices)
    g -= np.einsum("bij,bqij->q", multipliers.floors, derivatives.floors) + multipliers.rows @ derivatives.rows
    width = merit_function.width
    projected = np.clip(evaluation.p / width - g * width, program.lower / width, program.upper / width)
    return float(np.abs(projected - evaluation.p / width).max(initial=0.0))
