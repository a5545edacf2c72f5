"""The schedule for what a filter knows along the way, and others beside it: each under both questions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from obsdesign.scenario.schema import Scenario
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.posterior.filter_selection import select_for_filter
from obsdesign.selection.posterior.lost_sensors import questions_without
from obsdesign.selection.posterior.questions import FilterQuestion, FilterSettings, build_question
from obsdesign.selection.problem import SelectionProblem, switching_cost
from obsdesign.study.broken_rules import rule_violations
from obsdesign.study.rated_schedules import ALL_ON, FOR, GREEDY, FilterAnswer, RatedSchedule
from obsdesign.study.record import Candidate
from obsdesign.trajectory import Trajectory

_BAND = (0.05, 0.95)  # shares of random schedules


def answer_for_filter(
    scenario: Scenario,
    candidate: Candidate,
    instance: SelectionProblem,
    others: Mapping[str, np.ndarray],
    drawn: Sequence[np.ndarray],
    seed: int,
) -> FilterAnswer | None:
    """Choose the schedule for the filter along a path, and rate it, others by name and random ones (K, S) under both questions.

    None where there are too many sets of sensors to choose from.
    Raises SolveError where the filter is what is asked about and no schedule keeps the rules.
    """
    if not scenario.has_filter_schedule:
        return None
    path, nodes = candidate.path, candidate.nodes
    schedule = _schedule_for_filter(scenario, path, nodes, seed)
    question = _question(scenario, path, nodes)
    lost = questions_without(question, _robust_to(scenario)) if _robust_to(scenario) else []
    rate = partial(_rate, scenario, (question, *lost), instance)
    ours = {FOR["filter"]: schedule.chosen} if schedule.status.has_answer else {}
    greedy = {other.name: other.chosen for other in schedule.compared if other.name == GREEDY}
    everything = {**ours, **others, **greedy, ALL_ON: np.ones(instance.shape, dtype=bool)}
    random = [rate("random", chosen) for chosen in drawn]
    predicted = np.array([rated.predicted for rated in random]) if random else np.full((1, path.steps, path.x.shape[1]), np.nan)
    return FilterAnswer(
        schedule,
        tuple(rate(name, chosen) for name, chosen in everything.items()),
        np.sort([rated.cost for rated in random]),
        np.quantile(predicted, _BAND, axis=0),
    )


def _schedule_for_filter(scenario: Scenario, path: Trajectory, nodes: np.ndarray, seed: int) -> FilterSchedule:
    settings, prior = scenario.selection, scenario.prior_at_start
    return select_for_filter(
        scenario.system,
        path,
        prior,
        settings.per_segment,
        segment=path.t[nodes].tolist(),
        disturbance_psd=scenario.disturbance_psd,
        input_psd=scenario.input_psd,
        about=scenario.design.about or None,
        over=settings.over,
        criterion=scenario.filter_criterion,
        scale=prior.std,
        rules=scenario.rules_for("filter"),
        robust_to=_robust_to(scenario),
        gap=scenario.filter_gap,
        seed=seed,
        throw=scenario.schedule_question == "filter",
    )


def _question(scenario: Scenario, path: Trajectory, nodes: np.ndarray) -> FilterQuestion:
    settings = FilterSettings(
        segment=path.t[nodes].tolist(),
        disturbance_psd=scenario.disturbance_psd,
        input_psd=scenario.input_psd,
        unknown_inputs=(),
        about=scenario.design.about or None,
        over=scenario.selection.over,
        criterion=scenario.filter_criterion,
        scale=scenario.prior_at_start.std,
        active=None,
        floor=None,
    )
    return build_question(scenario.system, path, scenario.prior_at_start, settings)


def _robust_to(scenario: Scenario) -> int:
    """Return how many lost sensors the schedule for the filter is chosen for: none where the start is what is asked about."""
    return scenario.selection.robust_to if scenario.schedule_question == "filter" else 0


def _rate(
    scenario: Scenario, questions: tuple[FilterQuestion, ...], instance: SelectionProblem, name: str, chosen: np.ndarray
) -> RatedSchedule:
    """Return a schedule (K, S) under both questions; questions: with all sensors, and without each set that may be lost."""
    question = questions[0]
    cost = max(part.schedule_cost(chosen) for part in questions) + switching_cost(scenario.rules_for("filter"), question.segments, chosen)
    broken = rule_violations(scenario.selection.rules, question.segments, chosen)
    return RatedSchedule(name, chosen, instance.value(chosen), cost, question.deviations(chosen), broken)
