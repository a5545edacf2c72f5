"""Which sensors, when: the schedule for a path, what one would have done without thinking, losses, information against energy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from obsdesign.design.problem import DesignProblem
from obsdesign.rules.abstract import AbstractRule, Segments
from obsdesign.rules.energy_budget import EnergyBudget
from obsdesign.scenario.schema import Scenario
from obsdesign.selection.baselines import always, at_random, round_robin
from obsdesign.selection.build import posed
from obsdesign.selection.pareto import Pareto, pareto
from obsdesign.selection.problem import Instance, started
from obsdesign.selection.schedule import Schedule
from obsdesign.selection.sensor_loss import sensor_losses
from obsdesign.selection.solver import select_sensors
from obsdesign.study.record import Candidate, Rival, Selection
from obsdesign.trajectory import Trajectory

RANDOM_SCHEDULES = 1000  # the share of them that is better has a standard error of at most sqrt(1 / 4000) = 1.6 %
_RANDOM_UNDER_RULES = 200  # each takes a search of its own


def segments_of(scenario: Scenario, path: Trajectory, nodes: np.ndarray) -> Segments:
    """Return what rules know of the segments of a path between nodes (K+1,): names, times, and positions where the vehicle has any."""
    states = scenario.state_names
    place = [states.index(name) for name in ("x", "y") if name in states]
    tracks = tuple(path.x[first : last + 1, place] for first, last in pairwise(nodes)) if len(place) == 2 else None
    return Segments(scenario.sensor_names, len(nodes) - 1, path.t[nodes], tracks)


def select(scenario: Scenario, candidate: Candidate, problem: DesignProblem, seed: int) -> Selection:
    """Choose the sensors along a path, and rate the naive schedules."""
    blocks, asked, criterion = problem.scaled(candidate.blocks), scenario.selection, scenario.schedule_criterion
    segments = segments_of(scenario, candidate.path, candidate.nodes)
    (K, S), m, rules = blocks.shape[:2], asked.per_segment, asked.rules
    schedule = select_sensors(
        blocks, m, rules=rules, criterion=criterion, gap=asked.gap, seed=seed, robust_to=asked.robust_to, segments=segments
    )
    instance = posed(blocks, m, rules, criterion, asked.robust_to, segments)
    naive = scenario.naive_sensors
    fixed = np.any([always(K, S, scenario.sensor_names.index(name)) for name in naive], axis=0)
    rivals = [(f"{' + '.join(naive)} always", fixed), ("round robin", round_robin(K, S, m))]
    losses = sensor_losses(blocks, schedule, m, rules=rules, criterion=criterion, segments=segments) if S > 1 else ()
    return Selection(
        schedule=schedule,
        rivals=tuple(Rival(name, chosen, instance.value(chosen), broken(rules, segments, chosen)) for name, chosen in rivals),
        random_values=np.sort([instance.value(each) for each in _at_random(instance, m, bool(rules), np.random.default_rng([seed, 1]))]),
        losses=losses,
        pareto=_front(scenario, blocks, segments, seed) if asked.pareto else None,
        exact=_exact(candidate, problem, instance, schedule),
    )


def _exact(candidate: Candidate, problem: DesignProblem, instance: Instance, schedule: Schedule) -> float | None:
    """What the samples of a schedule say together, after the worst loss and less what switching costs; None where blocks say so."""
    if candidate.information.samples is None or not schedule.status.has_answer:
        return None
    left = [problem.scaled(candidate.under(schedule.chosen & (kept > 0))) for kept in instance.kept]
    return min(instance.criterion.value(W) for W in left) - instance.penalty(schedule.chosen)


def broken(rules: Sequence[AbstractRule], segments: Segments, chosen: np.ndarray) -> tuple[str, ...]:
    """Names of the rules that a schedule (K, S) breaks."""
    return tuple(str(rule) for rule in rules if not _keeps(rule, segments, chosen))


def _keeps(rule: AbstractRule, segments: Segments, chosen: np.ndarray) -> bool:
    terms = rule.terms(segments)
    if terms.available is not None and (chosen & ~terms.available).any():
        return False
    if terms.allowed is not None and not np.all(terms.allowed(chosen)):
        return False
    if terms.resource is not None:
        used = float(terms.resource.usage[chosen].sum() + terms.resource.start @ started(chosen).sum(axis=0))
        if used > terms.resource.limit + 1e-9 * max(1.0, terms.resource.limit):
            return False
    return terms.dwell is None or all(_dwells(chosen[:, s], int(least)) for s, least in enumerate(terms.dwell))


def _dwells(on: np.ndarray, least: int) -> bool:
    """Whether every stretch of a sensor (K,) is long enough, or ends with the path."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(int), [0]])))
    return all(last - first >= least or last == len(on) for first, last in zip(edges[::2], edges[1::2], strict=True))


def _at_random(instance: Instance, per_segment: int, under_rules: bool, random: np.random.Generator) -> Iterator[np.ndarray]:
    """Random schedules; where there are rules, the best ones for random prices that keep them."""
    K, S = instance.shape
    if not under_rules:
        for _ in range(RANDOM_SCHEDULES):
            yield at_random(K, S, per_segment, random)
        return
    usage, start = np.zeros((K, S)), np.zeros(S)
    for resource in instance.resources:
        typical = max(float(resource.usage.mean()), 1e-300)
        usage, start = usage + resource.usage / typical, start + resource.start / typical
    for _ in range(_RANDOM_UNDER_RULES):
        price = random.random((K, S))
        for dearer in (0.0, *2.0 ** np.arange(-4, 8)):  # until the limits are kept
            chosen, _ = instance.schedules.best(price - dearer * usage, dearer * start)
            if instance.keeps_limits(chosen):
                yield chosen
                break


def _front(scenario: Scenario, blocks: np.ndarray, segments: Segments, seed: int) -> Pareto:
    """Information against what the energy budget counts, within the other rules."""
    asked = scenario.selection
    (budget,) = (rule for rule in asked.rules if isinstance(rule, EnergyBudget))
    others = tuple(rule for rule in asked.rules if rule is not budget)
    return pareto(
        blocks,
        budget,
        asked.per_segment,
        points=asked.pareto,
        rules=others,
        criterion=scenario.schedule_criterion,
        segments=segments,
        seed=seed,
    )
