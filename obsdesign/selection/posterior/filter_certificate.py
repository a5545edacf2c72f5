"""The record of an answer: values recomputed apart from the search, bounds less what rounding may have added."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from obsdesign.selection.posterior.bounded_search import Answer
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.posterior.problem import PosteriorProblem, Walk
from obsdesign.selection.posterior.questions import FilterQuestion
from obsdesign.selection.posterior.sensor_prices import sensor_prices
from obsdesign.status import Status

ROUNDING_MARGIN = 1e-9
"""Of a cost: what rounding may add to a bound."""
TIME_WAS_UP = "time was up before the gap was closed"
"""What is said of a search that was cut short."""


def certify(
    question: FilterQuestion,
    problem: PosteriorProblem,
    walk: Walk,
    answer: Answer,
    *,
    gap: float,
) -> FilterSchedule:
    """Return the record of an answer, its value from roots of the information, with floors by a Kalman filter with the search's model."""
    chosen = problem.options.chosen(walk.nodes)
    cost, predicted = question.rating(chosen)
    value = cost + problem.switching(walk.nodes)
    bound = value if answer.is_exact else certified_bound(question, answer.bound, value, walk.value)
    remaining = question.gap_between(value, bound)
    worth = sensor_prices(question, problem, walk)
    return FilterSchedule(
        chosen,
        value,
        bound,
        remaining,
        predicted[question.path_nodes],
        status_of_gap(remaining, gap),
        answer.bound_by,
        worth.memory,
        worth.prices,
        (),
        question.path.t[question.nodes],
        question.system.model.sensor_names,
        (*question.notes, *worth.notes),
    )


def with_note(schedule: FilterSchedule, note: str) -> FilterSchedule:
    """Return the record that also says something."""
    return replace(schedule, notes=(*schedule.notes, note))


def accuracy_for(gap: float) -> float:
    """Return the gap to search for so that it is still the one asked for when rounding has been taken off the bound."""
    return max(0.0, 0.9 * gap - 4 * ROUNDING_MARGIN)


def status_of_gap(remaining: float, gap: float) -> Status:
    """Return whether what remains is the gap asked for, or as near as rounding lets a bound be."""
    return Status.OPTIMAL if remaining <= max(gap, 2 * ROUNDING_MARGIN) else Status.GAP_OPEN


def certified_bound(question: FilterQuestion, bound: float, value: float, searched_value: float) -> float:
    """Return the bound of a search less what rounding may have added to it; searched_value: what a schedule that costs `value` costs there.

    That is 1e-9 of the value, and ten times what the search takes the schedule to cost above what it does. With unknown inputs the
    search takes it to cost less, and what rounding did does not show: ten times what trial schedules were off by.
    """
    # a log det changes by the sum of the relative changes of its eigenvalues
    unknown_error = question.unknown_error * (abs(searched_value) if question.is_relative else len(question.costs.about))
    difference = searched_value - value if np.isfinite(value) else 0.0
    lowered = bound - ROUNDING_MARGIN * abs(searched_value) - 10 * max(0.0, difference, unknown_error)
    lowered = -np.inf if np.isnan(lowered) else min(lowered, value)
    return max(lowered, 0.0) if question.is_relative else lowered  # variances are not below 0


def certify_schedule(
    question: FilterQuestion, problem: PosteriorProblem, chosen: np.ndarray, proof: FilterSchedule, *, gap: float
) -> FilterSchedule | None:
    """Return the record of another schedule (K, S) under the bound of the best that was found; None where it does not keep the rules."""
    nodes = problem.options.nodes_of(chosen)
    if nodes is None:
        return None
    walk = problem.walk(nodes)
    schedule = certify(question, problem, walk, Answer(walk, proof.bound, proof.bound_by), gap=gap)
    return replace(schedule, compared=proof.compared, notes=proof.notes)


def failed_schedule(question: FilterQuestion, status: Status, reason: str) -> FilterSchedule:
    """Return the record without an answer to a question."""
    boundaries = question.path.t[question.nodes]
    steps, states = len(question.path_nodes), question.path.x.shape[1]
    return schedule_without_answer(question.system.model.sensor_names, boundaries, steps, states, status, reason)


def schedule_without_answer(
    sensors: tuple[str, ...], boundaries: np.ndarray, steps: int, states: int, status: Status, reason: str
) -> FilterSchedule:
    """Return the record without an answer: nothing on in the segments between boundaries (K+1,), NaN for N steps of n states."""
    K, S = len(boundaries) - 1, len(sensors)
    unknown = np.full((K, S), np.nan)
    predicted = np.full((steps, states), np.nan)
    off = np.zeros((K, S), dtype=bool)
    return FilterSchedule(off, np.nan, np.nan, np.nan, predicted, status, "nothing", np.nan, unknown, (), boundaries, sensors, (reason,))
