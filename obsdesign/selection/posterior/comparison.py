"""What others would have on: schedules to compare with, each with its cost."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.errors import InputError
from obsdesign.information.gramian import variational_gramian
from obsdesign.selection.baselines import round_robin, single_sensor
from obsdesign.selection.posterior.deadline import Deadline
from obsdesign.selection.posterior.filter_schedule import ComparedSchedule
from obsdesign.selection.posterior.problem import PosteriorProblem
from obsdesign.selection.posterior.questions import FilterQuestion
from obsdesign.selection.solver import select_sensors

_MAX_START = 200  # segments up to which the schedule for the start is looked for too
_MAX_START_CHOICES = 5000  # options in all segments up to which it is


def compare_schedules(
    question: FilterQuestion,
    sets: Sequence[FilterQuestion],
    problem: PosteriorProblem,
    per_segment: int,
    rivals: Sequence[tuple[str, np.ndarray]],
) -> tuple[tuple[ComparedSchedule, ...], bool]:
    """Return all on, nothing on, each sensor alone, round robin, greedy, the median and the best of random ones, and that for the start.

    Each with its cost, the largest of those under the questions in `sets`: one, or one for each loss. rivals: walks (K,) that keep the
    rules, by name; the others need not. And whether the problem's deadline left some out.
    """
    done = []
    for name, chosen in _others(question, problem, per_segment, rivals):
        if problem.deadline.is_over:
            return tuple(done), True
        cost = max(part.schedule_cost(chosen) for part in sets) + problem.options.switching_of(chosen)
        done.append(ComparedSchedule(name, chosen, cost))
    return tuple(done), problem.deadline.is_over


def _others(
    question: FilterQuestion, problem: PosteriorProblem, per_segment: int, rivals: Sequence[tuple[str, np.ndarray]]
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield schedules (K, S) by name."""
    K, S = question.answers.shape
    yield "all on", np.ones((K, S), dtype=bool)
    yield "nothing on", np.zeros((K, S), dtype=bool)
    for s, name in enumerate(question.system.model.sensor_names):
        yield f"{name} always", single_sensor(K, S, s)
    yield "round robin", round_robin(K, S, per_segment)
    for name, nodes in rivals:
        yield name, problem.options.chosen(nodes)
    is_small = K <= _MAX_START and K * len(problem.options.patterns) <= _MAX_START_CHOICES
    chosen = _for_the_start(question, per_segment, problem.deadline) if is_small and not problem.deadline.is_over else None
    if chosen is not None:
        yield "the schedule for the start", chosen


def _for_the_start(question: FilterQuestion, per_segment: int, deadline: Deadline) -> np.ndarray | None:
    """Return the schedule that tells most about the start of the path, without process noise and prior; None without an answer."""
    try:
        blocks = _blocks(question)
        schedule = select_sensors(
            blocks,
            per_segment,
            criterion=MinEigenvalue(),
            about=question.costs.about.tolist(),
            method="columns",
            gap=1e-3,
            time_limit=deadline.seconds_left,
            throw=False,
        )
    except InputError:  # information beyond what numbers hold
        return None
    return schedule.chosen if schedule.status.has_answer else None


def _blocks(question: FilterQuestion) -> np.ndarray:
    """Return what samples of sensors say of the start by segment (K, S, n, n), scaled."""
    information = variational_gramian(question.system, question.path)
    information = replace(information, blocks=information.blocks * (question.arrivals > 0)[:, :, None, None])
    scale = np.ones(question.path.x.shape[1])
    scale[question.costs.about] = question.costs.scale
    return information.by_stretch(question.nodes[:-1]) * scale[:, None] * scale * question.answers[:, :, None, None]
