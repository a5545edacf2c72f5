"""What others would have on: schedules to compare with, each with its cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.information.gramian import variational_gramian
from obsdesign.selection.baselines import round_robin, single_sensor
from obsdesign.selection.posterior.filter_schedule import ComparedSchedule
from obsdesign.selection.posterior.options import switching_of
from obsdesign.selection.posterior.problem import PosteriorProblem
from obsdesign.selection.posterior.questions import FilterQuestion
from obsdesign.selection.solver import select_sensors

_MAX_START = 200  # segments up to which the schedule for the start is looked for too
_MAX_START_CHOICES = 5000  # options in all segments up to which it is


def compare_schedules(
    question: FilterQuestion, problem: PosteriorProblem, per_segment: int, rivals: Sequence[tuple[str, np.ndarray]]
) -> tuple[ComparedSchedule, ...]:
    """Return all on, nothing on, each sensor alone, round robin, greedy, the median and the best of random ones, and that for the start.

    rivals: walks (K,) that keep the rules, by name. Of these, greedy and random ones keep the rules; the others need not.
    """
    K, S = question.answers.shape
    names = question.system.model.sensor_names
    fixed = [("all on", np.ones((K, S), dtype=bool)), ("nothing on", np.zeros((K, S), dtype=bool))]
    fixed += [(f"{name} always", single_sensor(K, S, s)) for s, name in enumerate(names)]
    fixed.append(("round robin", round_robin(K, S, per_segment)))
    fixed += [(name, problem.options.chosen(nodes)) for name, nodes in rivals]
    if K <= _MAX_START and K * len(problem.options.patterns) <= _MAX_START_CHOICES:
        fixed += _for_the_start(question, per_segment)
    return tuple(ComparedSchedule(name, chosen, _cost(question, problem, chosen)) for name, chosen in fixed)


def _cost(question: FilterQuestion, problem: PosteriorProblem, chosen: np.ndarray) -> float:
    return question.schedule_cost(chosen) + switching_of(problem.options, chosen)


def _for_the_start(question: FilterQuestion, per_segment: int) -> list[tuple[str, np.ndarray]]:
    """Return the schedule that tells most about the start of the path, without process noise and prior; empty without an answer."""
    information = variational_gramian(question.system, question.path)
    information = replace(information, blocks=information.blocks * (question.arrivals > 0)[:, :, None, None])
    scale = np.ones(question.path.x.shape[1])
    scale[question.costs.about] = question.costs.scale
    blocks = information.by_stretch(question.nodes[:-1]) * scale[:, None] * scale * question.answers[:, :, None, None]
    schedule = select_sensors(
        blocks, per_segment, criterion=MinEigenvalue(), about=question.costs.about.tolist(), method="columns", gap=1e-3, throw=False
    )
    return [("the schedule for the start", schedule.chosen)] if schedule.status.has_answer else []
