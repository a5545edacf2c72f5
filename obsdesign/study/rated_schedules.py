"""Schedules under two questions: what all samples say of the start, and what a filter knows along the way; and what is required."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.scenario.selection_tables import Question
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.posterior.requirement import RequiredKnowledge

FOR: dict[Question, str] = {"filter": "for the filter", "start": "for the start", "cheapest": "cheapest"}
"""What the schedule of each question is called."""
GREEDY, ALL_ON, ROUND_ROBIN = "greedy", "all on", "round robin"


@dataclass(frozen=True, eq=False)
class RatedSchedule:
    """A schedule (K, S) under both questions.

    information: the criterion of what all samples say of the start, larger is better; cost: that of the filter's covariance along the
    way, smaller is better; predicted (N, n): standard deviations after the samples at t_k; breaks: the rules that it breaks.
    """

    name: str
    chosen: np.ndarray
    information: float
    cost: float
    predicted: np.ndarray
    breaks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class FilterAnswer:
    """The schedule for the filter, and how others compare under both questions.

    rated: the schedules for filter and start first; random_costs (R,): of random schedules that keep the rules, sorted; band (2, N, n):
    the standard deviations below which one and nineteen of twenty of them lie; NaN where none was found.
    """

    schedule: FilterSchedule
    rated: tuple[RatedSchedule, ...]
    random_costs: np.ndarray
    band: np.ndarray

    def find(self, name: str) -> RatedSchedule | None:
        """Return the schedule of a name; None where there is none."""
        return next((rated for rated in self.rated if rated.name == name), None)


@dataclass(frozen=True, eq=False)
class CheapestAnswer:
    """The cheapest schedule that keeps what is required, or why there is none (status INFEASIBLE, `notes`), and what is required."""

    schedule: FilterSchedule
    required: tuple[RequiredKnowledge, ...]

    @property
    def nearest(self) -> RequiredKnowledge:
        """The requirement whose limit the schedule comes nearest to."""
        predicted = self.schedule.predicted
        return max(self.required, key=lambda required: required.worst(predicted)[0] / required.requirement.at_most)
