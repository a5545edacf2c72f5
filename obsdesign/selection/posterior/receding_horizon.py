"""In flight: what to switch on next, from what the filter knows now."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import require_count, require_known, require_within
from obsdesign.criteria.abstract import AbstractCriterion, Over
from obsdesign.criteria.trace_inverse import TraceInverse
from obsdesign.dynamics.answering_system import AnsweringSystem
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.dynamics.simulation import simulate
from obsdesign.errors import InputError, SolveError
from obsdesign.noise_density import DisturbancePsd, InputPsd
from obsdesign.prior import Prior
from obsdesign.rules.abstract import AbstractRule
from obsdesign.selection.posterior.deadline import Deadline, deadline_after
from obsdesign.selection.posterior.filter_certificate import schedule_without_answer
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.posterior.filter_selection import solve_question
from obsdesign.selection.posterior.formulation import formulate
from obsdesign.selection.posterior.options import Options, build_options
from obsdesign.selection.posterior.questions import FilterQuestion, FilterSettings, build_question
from obsdesign.selection.posterior.rival_walks import greedy_walk
from obsdesign.status import Status


def select_next(
    system: AbstractSystem,
    belief: Prior,
    inputs_ahead: ArrayLike,
    step: float,
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
    rules: Sequence[AbstractRule] = (),
    floor: Mapping[str, float] | None = None,
    answer_share: Mapping[str, float] | None = None,
    on: Sequence[str] = (),
    waiting: Sequence[str] = (),
    gap: float = 1e-2,
    time_limit: float | None = None,
) -> FilterSchedule:
    """Choose what to switch on next: the first row of the best schedule for the stretch ahead. Never raises: see `status` and `notes`.

    The stretch is where the inputs ahead take the mean of the belief; what is out of a sensor's sight there counts as little as its gate
    says. Called again after each segment with what the filter knows then, this is a receding horizon.

    Arguments:
        system: vehicle and sensors.
        belief: mean and covariance of the state now, before the samples of this instant.
        inputs_ahead (N, m): the known inputs that are going to be held, one row per step.
        step: length of a step [s].
        per_segment: how many sensors may be on at a time.
        segment: length of a segment [s], or the times at which segments begin and end.
        disturbance_psd: power spectral density (n,) or (n, n) of the process noise [unit^2/s]; None = none.
        input_psd: of known inputs, as for posterior_information; None = none.
        unknown_inputs: names of the inputs of which nothing is known.
        about: names of the states that count; None = all.
        over: which instants count: "mean", "worst", "end", or weights (N,).
        criterion: TraceInverse() (None), MinEigenvalue() or LogDet() of the covariance.
        scale (n,): what counts as one unit of each state; None = ones.
        rules: what schedules have to keep, and what switching costs, in the cost's unit.
        floor: sensor -> what its mean error within a segment never falls below, in the unit of its outputs.
        answer_share: sensor -> how often it answers when it is asked, from 0 to 1, beside what its gate says; 1 for those left out.
        on: names of the sensors that are on now: to keep them on is no switching-on.
        waiting: names of sensors that were switched on and have not answered yet: they stay on for the first segment,
            unless no schedule within the rules has them on.
        gap: how near to the best the schedule is to be proven, as a share of the cost (a difference for LogDet()).
        time_limit: the call ends about then [s], with what there is; None = never.
    """
    try:
        deadline = deadline_after(time_limit)
        settings = FilterSettings(
            segment, disturbance_psd, unknown_inputs, about, over, criterion or TraceInverse(), scale, None, floor, input_psd
        )
        path = simulate(system, belief.mean, inputs_ahead, step)
        answering = AnsweringSystem(system, _answer_shares(system, answer_share))
        require_count("per_segment", per_segment, maximum=len(system.model.channels))
        require_within("gap", gap)
        question = build_question(answering, path, belief, settings)
        sensors_on, sensors_waiting = _mask(system, "on", on), _mask(system, "waiting", waiting)
        options = build_options(tuple(rules), per_segment, question.segments, question.answers, sensors_on | sensors_waiting)
        with np.errstate(over="ignore", invalid="ignore"):  # covariances may grow beyond all numbers
            schedule = _best_ahead(question, _stay_on(options, sensors_waiting), gap, deadline)
            if schedule.status is Status.INFEASIBLE and sensors_waiting.any():  # a limit in sum may leave nothing for them
                schedule = _best_ahead(question, options, gap, deadline)
            return schedule
    except Exception as error:  # noqa: BLE001  # in flight a status is better than a traceback, whatever went wrong
        names = system.model.sensor_names if isinstance(system, AbstractSystem) else ()
        status = error.status if isinstance(error, SolveError) else Status.NUMERICAL_ERROR
        return schedule_without_answer(names, np.zeros(1), 0, 0, status, str(error) or type(error).__name__)


def _best_ahead(question: FilterQuestion, options: Options, gap: float, deadline: Deadline) -> FilterSchedule:
    question, problem = formulate(question, options, deadline)
    starts = [nodes for _, nodes in greedy_walk(problem)]
    return solve_question(question, problem, gap=gap, deadline=deadline, starts=starts)


def _answer_shares(system: AbstractSystem, answer_share: Mapping[str, float] | None) -> tuple[float, ...]:
    shares = answer_share or {}
    require_known("answer_share", tuple(shares), system.model.sensor_names)
    for name, share in shares.items():
        require_within(f"answer_share of {name}", share)
        if share > 1:
            raise InputError(f"answer_share of {name} is {share!r}: must be a number from 0 to 1")
    return tuple(float(shares.get(name, 1.0)) for name in system.model.sensor_names)


def _mask(system: AbstractSystem, what: str, names: Sequence[str]) -> np.ndarray:
    require_known(what, tuple(names), system.model.sensor_names)
    return np.isin(system.model.sensor_names, tuple(names))


def _stay_on(options: Options, waiting: np.ndarray) -> Options:
    """Return the options with those of the first segment alone that keep sensors (S,) on; as they were where the rules have none."""
    keeps = options.patterns[options.pattern_of_node][:, waiting].all(axis=1)
    allowed = options.allowed.copy()
    allowed[0] &= keeps
    return replace(options, allowed=allowed) if (allowed[0] & options.may_start).any() else options
