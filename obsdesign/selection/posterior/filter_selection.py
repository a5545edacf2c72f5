"""Which sensors, when, so that a filter knows most along the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array, require_count, require_within
from obsdesign.criteria.abstract import AbstractCriterion, Over
from obsdesign.criteria.trace_inverse import TraceInverse
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.errors import InputError, SolveError
from obsdesign.logs.log import Log
from obsdesign.noise_density import DisturbancePsd, InputPsd
from obsdesign.prior import Prior
from obsdesign.rules.abstract import AbstractRule
from obsdesign.selection.posterior.bounded_search import Answer, first_walk, search
from obsdesign.selection.posterior.comparison import compare_schedules
from obsdesign.selection.posterior.deadline import Deadline, deadline_after
from obsdesign.selection.posterior.few_schedules import all_tried, best_of_few, few_walks
from obsdesign.selection.posterior.filter_certificate import TIME_WAS_UP, accuracy_for, certify, failed_schedule, with_note
from obsdesign.selection.posterior.filter_schedule import ComparedSchedule, FilterSchedule
from obsdesign.selection.posterior.formulation import formulate, problem_of
from obsdesign.selection.posterior.lost_sensors import questions_without, solve_for_losses
from obsdesign.selection.posterior.options import Options, build_options
from obsdesign.selection.posterior.problem import PosteriorProblem
from obsdesign.selection.posterior.questions import FilterQuestion, FilterSettings, build_question
from obsdesign.selection.posterior.rival_walks import greedy_walk, random_walks
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

_WORTH_SAYING = 0.01  # of a cost


@validate_arguments
@np.errstate(over="ignore", invalid="ignore")  # covariances may grow beyond all numbers
def select_for_filter(
    system: AbstractSystem,
    path: Trajectory,
    prior: Prior,
    per_segment: int = 1,
    *,
    segment: float | Sequence[float] = 10.0,
    disturbance_psd: DisturbancePsd = None,
    input_psd: InputPsd = None,
    unknown_inputs: Sequence[str] = (),
    about: Sequence[str] | None = None,
    over: Over = "mean",
    criterion: AbstractCriterion | None = None,
    scale: ArrayLike | None = None,
    active: np.ndarray | None = None,
    rules: Sequence[AbstractRule] = (),
    floor: Mapping[str, float] | None = None,
    flown: np.ndarray | None = None,
    robust_to: int = 0,
    gap: float = 1e-3,
    time_limit: float | None = None,
    seed: int = 0,
    throw: bool = True,
    samples: Log | None = None,
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
        input_psd: of known inputs, as for posterior_information; None = none.
        unknown_inputs: names of the inputs of which nothing is known.
        about: names of the states that count; None = all.
        over: which instants count: "mean", "worst", "end" (k = N-1), or weights (N,) >= 0 of a sum.
        criterion: TraceInverse() (None): the trace of P; MinEigenvalue(): its largest eigenvalue; LogDet(): its log det.
        scale (n,): what counts as one unit of each state; None = ones.
        active (N, S): which samples arrive where a sensor is on; None = all. A segment in which nobody answers is coasted through.
            Needed where steps are of different lengths and sensors have rates; a segment then begins with the first instant at or
            after its time, and the mean is over time.
        rules: what schedules have to keep, and what switching costs, in the cost's unit.
        floor: sensor -> what its mean error within a segment never falls below, in the unit of its outputs, as `fit_floor` finds it for a
            sensor that is less sure than its model: each of its n samples of a segment counts as one of its own of standard deviation
            (sigma^2 + n floor^2)^1/2. The schedule is chosen with it, value and bound count it, `predicted` does not.
        flown (K, S): what was on when the path was driven; `compared` then has its cost and `notes` say how much could have been saved
            at most, by the bound.
        robust_to: how many sensors may be lost, whichever they are: value, bound, `predicted` and `compared` are those of the worst loss.
            The bound is the largest of those for one loss each: valid, but it seldom closes.
        gap: how near to the best the schedule is to be proven, as a share of the cost (a difference for LogDet()).
        time_limit: the call ends about then [s], with what there is: what was left out is said in `notes`, and a bound that was reached
            holds. None = never: so much work is done, the same on every machine.
        seed: seed of the random schedules that are compared.
        throw: False = return the failed record instead of raising SolveError.
        samples: a log, of whose samples those of sensors that are on count, each at its own time, whatever a gate says; with active, those
            of sensors that may be on from t_k to t_k+1. `predicted` is then behind all samples of its time. None = those of `active`.
    Raises InputError for what does not fit, SolveError where no schedule keeps the rules.
    Source of the bounds: docs/selection.md.
    """
    deadline = deadline_after(time_limit)
    require_count("per_segment", per_segment, maximum=len(system.model.channels))
    require_within("gap", gap)
    require_count("seed", seed, minimum=0)
    require_count("robust_to", robust_to, minimum=0, maximum=len(system.model.channels) - 1)
    if robust_to and flown is not None:
        raise InputError(f"flown is given with robust_to {robust_to}: what was flown has lost no sensor; leave one of them out")
    judged_by = criterion or TraceInverse()
    settings = FilterSettings(segment, disturbance_psd, unknown_inputs, about, over, judged_by, scale, active, floor, input_psd, samples)
    question = build_question(system, path, prior, settings)
    on = None if flown is None else require_schedule("flown", flown, question.answers.shape)
    options = build_options(tuple(rules), per_segment, question.segments, question.answers)
    question, problem = formulate(question, options, deadline)
    sets = [question] if not robust_to else questions_without(question, robust_to)
    rivals = greedy_walk(problem)
    if time_limit is None or not rivals:  # else the search comes first
        rivals += random_walks(problem, seed)
    starts = [nodes for _, nodes in rivals]
    schedule = solve_for_losses(sets, problem, gap=gap, deadline=deadline, starts=starts) if robust_to else None
    schedule = schedule or solve_question(question, problem, gap=gap, deadline=deadline, starts=starts)
    if schedule.status.has_answer:
        problem = replace(problem, deadline=deadline)
        rivals += random_walks(problem, seed) if time_limit is not None and len(rivals) == 1 else []
        compared, is_cut = compare_schedules(question, sets, problem, per_segment, rivals)
        notes = floor_notes(question, options, schedule, deadline) if question.floors.any() else ()
        cut = ("time was up: not all others were compared",) if is_cut else ()
        schedule = replace(schedule, compared=compared, notes=(*schedule.notes, *notes, *cut))
        return schedule if on is None else with_flown(question, problem, schedule, on)
    if throw:
        raise SolveError("sensor selection for the filter", schedule.status)
    return schedule


def solve_question(
    question: FilterQuestion, problem: PosteriorProblem, *, gap: float, deadline: Deadline, starts: Sequence[np.ndarray] = ()
) -> FilterSchedule:
    """Return the schedule for a checked question and its problem, compared with nothing; starts: walks (K,) to be no worse than."""
    least_costs = question.least_costs(problem.options.may_be_on)
    answer = search(problem, accuracy_for(gap), question.is_relative, starts, least_costs)
    is_cut, problem = problem.deadline.is_over, replace(problem, deadline=deadline)
    schedule = None if answer.walk is None else certify(question, problem, answer.walk, answer, gap=gap)
    if schedule is not None and schedule.gap <= gap:
        return schedule
    few = few_walks(problem.options, question.path.steps)
    best = best_of_few(problem.options, few, question.schedule_cost, deadline)
    if best is not None:
        walk = problem.walk(best)
        return certify(question, problem, walk, Answer(walk, np.inf, all_tried(few), is_exact=True), gap=gap)
    if schedule is None:
        return _no_schedule(question, len(problem.limits) <= 1 or (few is not None and not len(few)), is_cut)
    return with_note(schedule, TIME_WAS_UP) if is_cut and schedule.status is Status.GAP_OPEN else schedule


def _no_schedule(question: FilterQuestion, is_proven: bool, is_cut: bool) -> FilterSchedule:
    """Return the record that says why no schedule was met.

    One limit: what is still needed after each choice is known exactly, so that some walk would have been met.
    """
    if is_proven:
        return failed_schedule(question, Status.INFEASIBLE, "no schedule keeps the rules")
    if is_cut:
        return failed_schedule(question, Status.TIME_LIMIT, "time was up before a schedule was met that keeps all limits together")
    return failed_schedule(question, Status.LOCALLY_INFEASIBLE, "no schedule was met that keeps all limits together; there may be one")


def require_schedule(what: str, schedule: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return a schedule (K, S) as bool, or raise InputError."""
    on = as_array(what, schedule)
    if on.shape != shape:
        raise InputError(f"{what} has shape {on.shape}: must be {shape}, true or false for each segment and sensor")
    wrong = on[~np.isin(on, (0.0, 1.0))]
    if wrong.size:
        raise InputError(f"{what} has the entry {wrong[0]:g}: must be true or false for each segment and sensor")
    return on > 0


def with_flown(question: FilterQuestion, problem: PosteriorProblem, schedule: FilterSchedule, on: np.ndarray) -> FilterSchedule:
    """Return the record that also says what the schedule that was flown (K, S) costs, and how far that is from the best at most."""
    value = question.schedule_cost(on) + problem.options.switching_of(on)
    saved = f"{100 * (1 - schedule.bound / value):.3g} % of it" if question.is_relative else f"{value - schedule.bound:.3g}"
    note = f"what was flown costs {value:.4g}: no schedule would have saved more than {saved}"
    if value < schedule.bound:
        note = f"what was flown costs {value:.4g}, less than any schedule within the rules: these cost at least {schedule.bound:.4g}"
    return replace(schedule, compared=(*schedule.compared, ComparedSchedule("what was flown", on, value)), notes=(*schedule.notes, note))


def floor_notes(question: FilterQuestion, options: Options, schedule: FilterSchedule, deadline: Deadline) -> tuple[str, ...]:
    """Return what floors change, in words: what the schedule costs without them, and what one chosen without them costs with them."""
    without = replace(question, floors=np.zeros_like(question.floors))
    notes = (f"value and bound count the floors; without them this schedule costs {without.schedule_cost(schedule.chosen):.4g}",)
    if deadline.is_over or not question.is_relative:
        return notes
    walk = first_walk(problem_of(without, options, deadline))
    excess = 0.0 if walk is None else question.schedule_cost(options.chosen(walk.nodes)) / schedule.value - 1
    more = f"a schedule chosen without the floors costs {100 * excess:.0f} % more with them"
    return (*notes, more) if excess > _WORTH_SAYING else notes
