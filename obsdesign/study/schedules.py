"""Which sensors, when: the schedule for a path, what one would have done without thinking, losses, information against energy."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np

from obsdesign.design.problem import DesignProblem
from obsdesign.dynamics.path_segments import segments_along
from obsdesign.progress import Progress
from obsdesign.rules.abstract import Segments
from obsdesign.rules.energy_budget import EnergyBudget
from obsdesign.scenario.schema import Scenario
from obsdesign.selection.baselines import random_schedule, round_robin, single_sensor
from obsdesign.selection.build import build_problem
from obsdesign.selection.pareto import Pareto, pareto
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.schedule import Schedule
from obsdesign.selection.sensor_loss import sensor_losses
from obsdesign.selection.solver import select_sensors
from obsdesign.study.broken_rules import rule_violations
from obsdesign.study.cheapest_answer import answer_for_requirements
from obsdesign.study.filter_answer import answer_for_filter
from obsdesign.study.rated_schedules import FOR, ROUND_ROBIN
from obsdesign.study.record import Candidate, RivalSchedule, Selection

RANDOM_SCHEDULES = 1000  # the share of them that is better has a standard error of at most sqrt(1 / 4000) = 1.6 %
_RANDOM_UNDER_RULES = 200  # each takes a search of its own
_RANDOM_FOR_FILTER = 50  # each takes a posterior along the path


def select(scenario: Scenario, candidate: Candidate, problem: DesignProblem, seed: int, progress: Progress | None = None) -> Selection:
    """Choose the sensors along a path, for the start, for the filter and for what is required, and rate the naive schedules."""
    blocks, settings, criterion = problem.scaled(candidate.blocks), scenario.selection, scenario.schedule_criterion
    segments = segments_along(scenario.system.model, candidate.path, candidate.nodes)
    (K, S), m, rules = blocks.shape[:2], settings.per_segment, scenario.rules_for("start")
    schedule = select_sensors(
        blocks,
        m,
        rules=rules,
        criterion=criterion,
        gap=settings.gap,
        seed=seed,
        robust_to=settings.robust_to,
        segments=segments,
        progress=progress,
    )
    instance = build_problem(blocks, m, rules, criterion, settings.robust_to, segments)
    rivals = _naive_schedules(scenario, K)
    losses = sensor_losses(blocks, schedule, m, rules=rules, criterion=criterion, segments=segments) if S > 1 else ()
    cheapest = answer_for_requirements(scenario, candidate, seed)
    others = ({FOR["start"]: schedule.chosen} if schedule.status.has_answer else {}) | rivals
    if cheapest is not None and cheapest.schedule.status.has_answer:
        others = {FOR["cheapest"]: cheapest.schedule.chosen} | others
    return Selection(
        schedule=schedule,
        rivals=tuple(
            RivalSchedule(name, chosen, instance.value(chosen), rule_violations(rules, segments, chosen)) for name, chosen in rivals.items()
        ),
        random_values=np.sort([instance.value(chosen) for chosen in _random_schedules(instance, m, bool(rules), seed)]),
        losses=losses,
        pareto=_pareto_front(scenario, blocks, segments, seed, progress) if settings.pareto else None,
        exact=_exact_value(candidate, problem, instance, schedule),
        question=scenario.schedule_question,
        filter=answer_for_filter(
            scenario,
            candidate,
            instance,
            others,
            tuple(islice(_random_schedules(instance, m, bool(rules), seed), _RANDOM_FOR_FILTER)),
            seed,
        ),
        cheapest=cheapest,
    )


def _naive_schedules(scenario: Scenario, segments: int) -> dict[str, np.ndarray]:
    """What one would have on without thinking, by name (K, S): the naive sensors throughout, and one after the other."""
    names, naive, per_segment = scenario.sensor_names, scenario.naive_sensors, scenario.selection.per_segment
    fixed = np.any([single_sensor(segments, len(names), names.index(name)) for name in naive], axis=0)
    return {f"{' + '.join(naive)} always": fixed, ROUND_ROBIN: round_robin(segments, len(names), per_segment)}


def _exact_value(candidate: Candidate, problem: DesignProblem, instance: SelectionProblem, schedule: Schedule) -> float | None:
    """What the samples of a schedule say together, after the worst loss and less what switching costs; None where blocks say so."""
    if candidate.information.samples is None or not schedule.status.has_answer:
        return None
    matrices = [problem.scaled(candidate.information_under(schedule.chosen & (working > 0))) for working in instance.working_sensors]
    return min(instance.criterion.value(W) for W in matrices) - instance.penalty(schedule.chosen)


def _random_schedules(instance: SelectionProblem, per_segment: int, under_rules: bool, seed: int) -> Iterator[np.ndarray]:
    """Random schedules; where there are rules, the best ones for random prices that keep them."""
    (K, S), random = instance.shape, np.random.default_rng([seed, 1])
    if not under_rules:
        for _ in range(RANDOM_SCHEDULES):
            yield random_schedule(K, S, per_segment, random)
        return
    usage, start = np.zeros((K, S)), np.zeros(S)
    for resource in instance.resources:
        typical = max(float(resource.usage.mean()), 1e-300)
        usage, start = usage + resource.usage / typical, start + resource.start / typical
    for _ in range(_RANDOM_UNDER_RULES):
        price = random.random((K, S))
        for price_factor in (0.0, *2.0 ** np.arange(-4, 8)):  # until the limits are kept
            chosen, _ = instance.schedules.maximise(price - price_factor * usage, price_factor * start)
            if instance.is_within_limits(chosen):
                yield chosen
                break


def _pareto_front(scenario: Scenario, blocks: np.ndarray, segments: Segments, seed: int, progress: Progress | None) -> Pareto:
    """Information against what the energy budget counts, within the other rules."""
    settings = scenario.selection
    (budget,) = (rule for rule in settings.rules if isinstance(rule, EnergyBudget))
    others = tuple(rule for rule in settings.rules if rule is not budget)
    return pareto(
        blocks,
        budget,
        settings.per_segment,
        points=settings.pareto,
        rules=others,
        criterion=scenario.schedule_criterion,
        segments=segments,
        seed=seed,
        progress=progress,
    )
