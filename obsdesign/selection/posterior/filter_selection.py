"""Which sensors, when, so that a filter knows most along the way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count, require_positive, require_within
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.criteria.trace_inverse import TraceInverse
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.errors import SolveError
from obsdesign.prior import Prior
from obsdesign.round_off import standard_deviations
from obsdesign.rules.abstract import AbstractRule
from obsdesign.selection.posterior.bounded_search import Answer, search
from obsdesign.selection.posterior.comparison import compare_schedules
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.posterior.options import Options, build_options
from obsdesign.selection.posterior.problem import PosteriorProblem, Walk
from obsdesign.selection.posterior.questions import FilterQuestion, Over, build_question
from obsdesign.selection.posterior.segment_maps import segment_maps
from obsdesign.selection.posterior.sensor_prices import sensor_prices
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

_MARGIN = 1e-9  # of a cost: what rounding may add to a bound


@validate_arguments
def select_for_filter(
    system: AbstractSystem,
    path: Trajectory,
    prior: Prior,
    per_segment: int = 1,
    *,
    segment: float | Sequence[float] = 10.0,
    disturbance_psd: ArrayLike | None = None,
    unknown_inputs: Sequence[str] = (),
    about: Sequence[str] | None = None,
    over: Over = "mean",
    criterion: AbstractCriterion | None = None,
    scale: ArrayLike | None = None,
    active: np.ndarray | None = None,
    rules: Sequence[AbstractRule] = (),
    gap: float = 1e-3,
    time_limit: float | None = None,
    seed: int = 0,
    throw: bool = True,
) -> FilterSchedule:
    """Choose which sensors are on in which segment so that a filter knows most along the way, with a bound on every schedule.

    min over schedules of the mean (largest, last, weighted sum) over k of cost(S^-1 P_k S^-1), P_k the covariance of the states
    `about` after the samples at t_k, k = 0..N-1, of the filter that knows prior, process noise and how samples err.

    Arguments:
        system: vehicle and sensors.
        path: the path along which samples are taken.
        prior: what is known of x(t_0).
        per_segment: how many sensors may be on at a time.
        segment: length of a segment [s], a whole multiple of the step; the last may be shorter. Or the times (K+1,) at which
            segments begin and end, from the path's first to its last.
        disturbance_psd: power spectral density (n,) or (n, n) of the process noise [unit^2/s], Q = psd * step; None = none: what has once
            been seen of a state that does not move is never forgotten.
        unknown_inputs: names of the inputs of which nothing is known.
        about: names of the states that count; None = all.
        over: which instants count: "mean", "worst", "end" (k = N-1), or weights (N,) >= 0 of a sum.
        criterion: TraceInverse() (None): the trace of P; MinEigenvalue(): its largest eigenvalue; LogDet(): its log det.
        scale (n,): what counts as one unit of each state; None = ones.
        active (N, S): which samples arrive where a sensor is on; None = all. A segment in which nobody answers is coasted through.
        rules: what schedules have to keep, and what switching costs, in the cost's unit.
        gap: how near to the best the schedule is to be proven, as a share of the cost (a difference for LogDet()).
        time_limit: stops with what there is [s]; None = never. Without one, so much work is done, the same on every machine.
        seed: seed of the random schedules that are compared.
        throw: False = return the failed record instead of raising SolveError.
    Raises InputError for what does not fit, SolveError where no schedule keeps the rules.
    Source of the bounds: docs/selection.md.
    """
    require_count("per_segment", per_segment, maximum=len(system.model.channels))
    require_within("gap", gap)
    require_count("seed", seed, minimum=0)
    if time_limit is not None:
        require_positive("time_limit", time_limit)
    question = build_question(
        system,
        path,
        prior,
        segment=segment,
        disturbance_psd=disturbance_psd,
        unknown_inputs=unknown_inputs,
        about=about,
        over=over,
        criterion=criterion or TraceInverse(),
        scale=scale,
        active=active,
    )
    options = build_options(tuple(rules), per_segment, question.segments, question.answers)
    problem = problem_of(question, options)
    answer = search(problem, max(0.0, 0.9 * gap - 4 * _MARGIN), question.costs.criterion.gap_kind == "relative")
    if answer.walk is None:
        if throw:
            raise SolveError("sensor selection for the filter", Status.INFEASIBLE)
        return failed_schedule(question, Status.INFEASIBLE)
    return certify(question, problem, answer.walk, answer, gap=gap, per_segment=per_segment, seed=seed)


def problem_of(question: FilterQuestion, options: Options) -> PosteriorProblem:
    """Return the problem that methods work on."""
    model = question.linear_model
    maps = segment_maps(model, question.nodes, options.patterns, question.costs)
    return PosteriorProblem(maps, options, model.initial_covariance, question.costs.is_worst)


def certify(
    question: FilterQuestion, problem: PosteriorProblem, walk: Walk, answer: Answer, *, gap: float, per_segment: int, seed: int
) -> FilterSchedule:
    """Return the record of an answer, its value recomputed by `posterior_information`."""
    chosen = problem.options.chosen(walk.nodes)
    J = question.information(chosen)
    value = question.cost(J) + problem.switching(walk.nodes)
    bound = _bound(answer.bound, value, walk.value)
    is_relative = question.costs.criterion.gap_kind == "relative"
    worth = sensor_prices(question, problem, walk)
    remaining = (1 - bound / value if value else 0.0) if is_relative else value - bound
    return FilterSchedule(
        chosen,
        value,
        bound,
        remaining,
        standard_deviations(J),
        Status.OPTIMAL if remaining <= max(gap, 2 * _MARGIN) else Status.GAP_OPEN,
        answer.bound_by,
        worth.memory,
        worth.prices,
        compare_schedules(question, problem, per_segment, seed),
        question.path.t[question.nodes],
        question.system.model.sensor_names,
    )


def _bound(bound: float, value: float, model_value: float) -> float:
    """Return a bound less what rounding may have added to it: 1e-9 of the value, and what the model's own value is above the exact one."""
    error = max(0.0, model_value - value) if np.isfinite(value) else 0.0
    return min(bound - _MARGIN * abs(model_value) - 10 * error, value)


def failed_schedule(question: FilterQuestion, status: Status) -> FilterSchedule:
    """Return the record of a question without an answer."""
    K, S = len(question.nodes) - 1, len(question.system.model.channels)
    return FilterSchedule(
        np.zeros((K, S), dtype=bool),
        np.nan,
        np.nan,
        np.nan,
        np.full((question.path.steps, question.path.x.shape[1]), np.nan),
        status,
        "nothing",
        np.nan,
        np.full((K, S), np.nan),
        (),
        question.path.t[question.nodes],
        question.system.model.sensor_names,
    )
