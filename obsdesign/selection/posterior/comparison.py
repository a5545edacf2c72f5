"""What others would have on: schedules to compare with, each with its cost."""

from __future__ import annotations

import numpy as np

from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.information.gramian import variational_gramian
from obsdesign.selection.baselines import round_robin, single_sensor
from obsdesign.selection.posterior.filter_schedule import ComparedSchedule
from obsdesign.selection.posterior.options import switching_of
from obsdesign.selection.posterior.problem import PosteriorProblem
from obsdesign.selection.posterior.questions import FilterQuestion
from obsdesign.selection.posterior.trellis import smallest_rest, start_of, successors
from obsdesign.selection.solver import select_sensors

_RANDOM = 100  # schedules drawn
_MAX_START = 200  # segments up to which the schedule for the start is looked for too
_MAX_START_CHOICES = 5000  # options in all segments up to which it is


def compare_schedules(question: FilterQuestion, problem: PosteriorProblem, per_segment: int, seed: int) -> tuple[ComparedSchedule, ...]:
    """Return all on, nothing on, each sensor alone, round robin, greedy, the median and the best of random ones, and that for the start.

    Of these, greedy and random ones keep the rules; the others need not.
    """
    K, S = question.answers.shape
    names = question.system.model.sensor_names
    fixed = [("all on", np.ones((K, S), dtype=bool)), ("nothing on", np.zeros((K, S), dtype=bool))]
    fixed += [(f"{name} always", single_sensor(K, S, s)) for s, name in enumerate(names)]
    fixed.append(("round robin", round_robin(K, S, per_segment)))
    fixed += [(name, problem.options.chosen(nodes)) for name, nodes in _within_rules(problem, seed)]
    if K <= _MAX_START and K * len(problem.options.patterns) <= _MAX_START_CHOICES:
        fixed += _for_the_start(question, per_segment)
    return tuple(ComparedSchedule(name, chosen, _cost(question, problem, chosen)) for name, chosen in fixed)


def _cost(question: FilterQuestion, problem: PosteriorProblem, chosen: np.ndarray) -> float:
    return question.schedule_cost(chosen) + switching_of(problem.options, chosen)


def _within_rules(problem: PosteriorProblem, seed: int) -> list[tuple[str, np.ndarray]]:
    """Return the walks (K,) of greedy choices, and of the median and the best of random ones."""
    greedy = _draw(problem, 1, None)
    drawn = _draw(problem, _RANDOM, np.random.default_rng([seed, 2]))
    walks = [("greedy", greedy[0][0])] if len(greedy[0]) else []
    nodes, values = drawn
    if len(values):
        order = np.argsort(values, kind="stable")
        walks += [("median of random ones", nodes[order[len(order) // 2]]), ("best of random ones", nodes[order[0]])]
    return walks


def _draw(problem: PosteriorProblem, count: int, random: np.random.Generator | None) -> tuple[np.ndarray, np.ndarray]:
    """Return walks (B, K) that keep the rules and their costs (B,): each step at random, or the one that costs least at once."""
    rest, options = smallest_rest(problem), problem.options
    frontier = start_of(problem, count)
    nodes = np.empty((count, problem.segments), dtype=int)
    alive = np.arange(count)
    for k in range(problem.segments):
        step = successors(problem, frontier, k, rest)
        if random is not None:
            step = step.only(_first_of_each(step.parent, random.random(len(step.node))))
        cost, P = problem.maps.advance(k, options.pattern_of_node[step.node], frontier.P[:, :, step.parent])
        switching = options.switching_costs[frontier.node[step.parent], step.node]
        best = _first_of_each(step.parent, cost + switching)
        alive, nodes = alive[step.parent[best]], nodes[step.parent[best]]
        nodes[:, k] = step.node[best]
        frontier = frontier.advance(step, best, cost, switching, P, problem.is_worst)
    return nodes, frontier.value(problem.is_worst)


def _first_of_each(group: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Return the place of the lowest score (B,) in each group (B,)."""
    order = np.lexsort((score, group))
    return order[np.diff(group[order], prepend=-1) > 0]


def _for_the_start(question: FilterQuestion, per_segment: int) -> list[tuple[str, np.ndarray]]:
    """Return the schedule that tells most about the start of the path, without process noise and prior; empty without an answer."""
    information = variational_gramian(question.system, question.path)
    scale = np.ones(question.path.x.shape[1])
    scale[question.costs.about] = question.costs.scale
    blocks = information.by_stretch(question.nodes[:-1]) * scale[:, None] * scale
    schedule = select_sensors(
        blocks, per_segment, criterion=MinEigenvalue(), about=question.costs.about.tolist(), method="columns", gap=1e-3, throw=False
    )
    return [("the schedule for the start", schedule.chosen)] if schedule.status.has_answer else []
