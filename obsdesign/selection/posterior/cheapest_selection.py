"""The inverse question: the cheapest schedule with which a filter knows what is required."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from math import gcd, lcm

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count, require_known, require_within
from obsdesign.criteria.trace_inverse import TraceInverse
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.errors import SolveError
from obsdesign.noise_density import DisturbancePsd, InputPsd
from obsdesign.prior import Prior
from obsdesign.rules.abstract import AbstractRule
from obsdesign.rules.switching_cost import SwitchingCost
from obsdesign.selection.baselines import round_robin, single_sensor
from obsdesign.selection.posterior.cheapest_search import Cheapest, Target, search_cheapest
from obsdesign.selection.posterior.deadline import Deadline, deadline_after
from obsdesign.selection.posterior.filter_certificate import TIME_WAS_UP, failed_schedule, with_note
from obsdesign.selection.posterior.filter_schedule import ComparedSchedule, FilterSchedule
from obsdesign.selection.posterior.formulation import OF_SEARCH, problem_of, settle_unknown_inputs
from obsdesign.selection.posterior.options import Options, build_options
from obsdesign.selection.posterior.problem import PosteriorProblem, Purchase, Walk
from obsdesign.selection.posterior.questions import FilterQuestion, FilterSettings, build_question
from obsdesign.selection.posterior.requirement import RequiredKnowledge, Requirement, require_requirements
from obsdesign.selection.posterior.segment_maps import segment_maps
from obsdesign.selection.posterior.sensor_prices import sensor_prices
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

_EXACT = 1e-11  # of a cost: a gap that is rounding
_FINEST = 1000  # parts of 1 that costs are looked at in when their unit is looked for


@validate_arguments
@np.errstate(over="ignore", invalid="ignore")  # covariances may grow beyond all numbers
def cheapest_schedule(
    system: AbstractSystem,
    path: Trajectory,
    prior: Prior,
    require: Sequence[Requirement] | Requirement,
    cost: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
    *,
    per_segment: int = 1,
    segment: float | Sequence[float] = 10.0,
    disturbance_psd: DisturbancePsd = None,
    input_psd: InputPsd = None,
    unknown_inputs: Sequence[str] = (),
    active: np.ndarray | None = None,
    rules: Sequence[AbstractRule] = (),
    gap: float = 1e-3,
    time_limit: float | None = None,
    seed: int = 0,
    throw: bool = True,
) -> FilterSchedule:
    """Choose the cheapest schedule with which a filter knows what is required along the way, with a bound on the cost of every one.

    min over schedules of sum_k sum_s cost_s on_ks + sum of start_s over every switching-on, subject to every requirement and the rules.
    `value` and `bound` of the record are costs, gap = 1 - bound / value. Where all costs are whole multiples of a unit (of 1/1000 at
    least), so is every schedule's, and the bound is rounded up to one. `prices` and `memory` are about the mean of the required
    variances, each in units of its at_most^2. `compared` has cost inf where a schedule breaks a requirement.

    What no schedule can keep is an answer, not an error: status INFEASIBLE, and a note such as "impossible: with all on, x is 7.1 m at
    83 s" (all sensors in all segments, whatever the rules), or that no schedule within the rules keeps what all sensors together would.

    Arguments:
        system: vehicle and sensors.
        path: the path along which samples are taken.
        prior: what is known of x(t_0).
        require: what has to be known; all of it.
        cost: per segment that a sensor is on, by sensor (0 for those it leaves out), >= 0; None = 1 each: fewest segments on.
        start: per switching-on, by sensor, in the unit of the costs, also in the first segment; None = nothing.
        per_segment: how many sensors may be on at a time.
        segment: length of a segment [s], or the times (K+1,) at which segments begin and end; as in `select_for_filter`.
        disturbance_psd: power spectral density (n,) or (n, n) of the process noise [unit^2/s]; None = none.
        input_psd: of known inputs, as for posterior_information; None = none.
        unknown_inputs: names of the inputs of which nothing is known.
        active (N, S): which samples arrive where a sensor is on; None = all.
        rules: what schedules have to keep; a SwitchingCost adds to the cost.
        gap: how near to the least the cost is to be proven, as a share of it.
        time_limit: stops with what there is [s]; None = never. Without one, so much work is done, the same on every machine.
        seed: taken for the sake of one signature; nothing is drawn.
        throw: False = return the record without an answer instead of raising SolveError where the search found none and proved nothing.
    Raises InputError for what does not fit, SolveError where no schedule was found that keeps the requirements and none was proven
    impossible. Source of the bounds: docs/selection.md.
    """
    deadline = deadline_after(time_limit)
    require_count("per_segment", per_segment, maximum=len(system.model.channels))
    require_within("gap", gap)
    require_count("seed", seed, minimum=0)
    required = require_requirements(require, system.model, path.t[: path.steps])
    expense = require_expense(cost, start, system.model.sensor_names)
    settings = FilterSettings(
        segment,
        disturbance_psd,
        unknown_inputs,
        about=tuple({name: None for requirement in required for name in requirement.requirement.about}),
        over="mean",
        criterion=TraceInverse(),
        scale=_scale_of(required, system.model.state_names),
        active=active,
        floor=None,
        input_psd=input_psd,
    )
    question = build_question(system, path, prior, settings)
    reason = _impossible_with_all_on(question, required)
    if reason:
        return failed_schedule(question, Status.INFEASIBLE, reason)
    options = build_options((*rules, SwitchingCost(dict(enumerate(expense.start.tolist())))), per_segment, question.segments, None)
    question = settle_unknown_inputs(question, options, deadline)
    problem = purchase_problem(question, options, expense.cost, required, deadline.share(OF_SEARCH))
    unit = common_unit(np.concatenate([expense.cost, options.switching]))
    target = Target(lambda nodes: _holds(question, required, options.chosen(nodes)), unit, 0.9 * gap)
    answer = search_cheapest(problem, target, path.steps)
    if answer.walk is not None:
        is_cut = problem.deadline.is_over
        schedule = _certify(question, problem, answer.walk, answer, gap, deadline)
        schedule = with_note(schedule, TIME_WAS_UP) if is_cut and schedule.status is Status.GAP_OPEN else schedule
        return replace(schedule, compared=_compare(question, options, expense.cost, required, per_segment))
    if np.isposinf(answer.bound):
        return failed_schedule(question, Status.INFEASIBLE, _impossible_within_rules(required, per_segment, rules, answer))
    status = Status.TIME_LIMIT if problem.deadline.is_over else Status.LOCALLY_INFEASIBLE
    if throw:
        raise SolveError("the cheapest schedule", status, f"every one costs at least {answer.bound:g}")
    return failed_schedule(question, status, f"every schedule costs at least {answer.bound:g}")


@dataclass(frozen=True, eq=False)
class Expense:
    """What sensors cost (S,): per segment on, and per switching-on."""

    cost: np.ndarray
    start: np.ndarray


def require_expense(cost: Mapping[str, float] | None, start: Mapping[str, float] | None, names: tuple[str, ...]) -> Expense:
    """Return the costs of sensors by name, or raise InputError."""
    for what, table in (("cost", cost), ("start", start)):
        require_known(what, tuple(table or ()), names)
        for name, value in (table or {}).items():
            require_within(f"{what} of {name}", value)
    per_on = np.ones(len(names)) if cost is None else np.array([float(cost.get(name, 0.0)) for name in names])
    return Expense(per_on, np.array([float((start or {}).get(name, 0.0)) for name in names]))


def _scale_of(required: tuple[RequiredKnowledge, ...], names: tuple[str, ...]) -> np.ndarray:
    """Return the least limit that stands above each state (n,), 1 where none does."""
    limits = np.full(len(names), np.inf)
    for requirement in required:
        limits[requirement.places] = np.minimum(limits[requirement.places], requirement.requirement.at_most)
    return np.where(np.isfinite(limits), limits, 1.0)


def common_unit(values: np.ndarray) -> float:
    """Return the largest number of which all values (n,) >= 0 are whole multiples; 0 where there is none of at least 1/1000 of 1."""
    parts = [Fraction(value).limit_denominator(_FINEST) for value in values.tolist() if value > 0]
    if not parts or any(abs(float(part) - value) > 1e-12 * value for part, value in zip(parts, values[values > 0], strict=True)):
        return 0.0
    denominator = reduce(lcm, (part.denominator for part in parts))
    return reduce(gcd, (int(part * denominator) for part in parts)) / denominator


def purchase_problem(
    question: FilterQuestion, options: Options, cost: np.ndarray, required: tuple[RequiredKnowledge, ...], deadline: Deadline
) -> PosteriorProblem:
    """Return the problem of cost (S,) per segment on and limits of how often requirements may fail, worked on until a deadline."""
    model = question.linear_model
    maps = segment_maps(
        model, question.nodes, options.patterns, tuple(requirement.costs(10 * question.unknown_error) for requirement in required)
    )
    on_costs = np.repeat((options.patterns[options.pattern_of_node] @ cost)[None], options.segments, axis=0)
    limits = np.array([float(requirement.misses) for requirement in required])
    return PosteriorProblem(maps, options, model.initial_covariance, is_worst=False, purchase=Purchase(on_costs, limits), deadline=deadline)


def _holds(question: FilterQuestion, required: tuple[RequiredKnowledge, ...], chosen: np.ndarray) -> bool:
    predicted = question.deviations(chosen)
    return all(requirement.holds(predicted) for requirement in required)


def _times(question: FilterQuestion) -> np.ndarray:
    return question.path.t[: question.path.steps]


def _impossible_with_all_on(question: FilterQuestion, required: tuple[RequiredKnowledge, ...]) -> str:
    """Return which requirements fail with every sensor on, in words; empty where all hold. More samples never make a variance larger."""
    predicted = question.deviations(np.ones_like(question.answers))
    failing = [requirement.excess(predicted, _times(question)) for requirement in required if not requirement.holds(predicted)]
    return f"impossible: with all on, {'; '.join(failing)}" if failing else ""


def _impossible_within_rules(
    required: tuple[RequiredKnowledge, ...], per_segment: int, rules: Sequence[AbstractRule], answer: Cheapest
) -> str:
    kept = ", ".join([f"{per_segment} at a time", *(str(rule) for rule in rules)])
    wanted = "; ".join(str(requirement.requirement) for requirement in required)
    return f"impossible: with all on it is kept, but no schedule within the rules ({kept}) keeps {wanted}, by {answer.bound_by}"


def _certify(
    question: FilterQuestion, problem: PosteriorProblem, walk: Walk, answer: Cheapest, gap: float, deadline: Deadline
) -> FilterSchedule:
    """Return the record of an answer; that it keeps the requirements was seen with `posterior_information`."""
    chosen = problem.options.chosen(walk.nodes)
    bound = min(answer.bound, walk.value)
    remaining = 1 - bound / walk.value if walk.value else 0.0
    variances = problem_of(question, problem.options, deadline)
    worth = sensor_prices(question, variances, variances.walk(walk.nodes))
    return FilterSchedule(
        chosen,
        walk.value,
        bound,
        remaining,
        question.deviations(chosen)[question.path_nodes],
        Status.OPTIMAL if remaining <= max(gap, _EXACT) else Status.GAP_OPEN,
        answer.bound_by,
        worth.memory,
        worth.prices,
        (),
        question.path.t[question.nodes],
        question.system.model.sensor_names,
        (*question.notes, *worth.notes),
    )


def _compare(
    question: FilterQuestion, options: Options, cost: np.ndarray, required: tuple[RequiredKnowledge, ...], per_segment: int
) -> tuple[ComparedSchedule, ...]:
    """Return all on, each sensor alone and round robin, with their costs; inf where a requirement is broken."""
    K, S = question.answers.shape
    schedules = [("all on", np.ones((K, S), dtype=bool))]
    schedules += [(f"{name} always", single_sensor(K, S, s)) for s, name in enumerate(question.system.model.sensor_names)]
    schedules.append(("round robin", round_robin(K, S, per_segment)))
    costs = [on.sum(axis=0) @ cost + options.switching_of(on) if _holds(question, required, on) else np.inf for _, on in schedules]
    return tuple(ComparedSchedule(name, on, float(value)) for (name, on), value in zip(schedules, costs, strict=True))
