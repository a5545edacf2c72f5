"""Path and schedule for what the samples tell of the start."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.errors import InputError
from obsdesign.information.accumulation import segment_information
from obsdesign.joint.abstract import AbstractJointProblem
from obsdesign.selection.schedule import Schedule, gap_of, schedule_information
from obsdesign.selection.solver import select_sensors
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class JointProblem(AbstractJointProblem[Schedule]):
    """max criterion(S (known + sum_ks s_ks W_ks(p)) S) over paths p of a problem and schedules s (K, S) that keep the rules.

    Of the states that the problem judges, the others being found as well.
    Raises InputError for a problem that schedules cannot answer, and for counts that do not fit it.
    """

    def require_criterion(self) -> None:
        """Raise InputError for a criterion of more than the samples' information."""
        if self.problem.criterion.knowledge is not None:
            kind = type(self.problem.criterion).__name__
            raise InputError(
                f"codesign: {kind} is not additive over sensors: must be a criterion of the samples' information alone,"
                " or the question 'filter'"
            )

    def require_information(self, path: Trajectory) -> None:
        """Raise InputError for a path along which samples have no information."""
        self.blocks(path)

    def blocks(self, path: Trajectory) -> np.ndarray:
        """S W_ks S (K, S, n, n) along a path."""
        return self.problem.scaled(segment_information(self.problem.system, path, self.segments))

    def select_schedule(self, path: Trajectory, proven: bool = False) -> Schedule:
        """Return the best schedule found for a path; proven: with branch and bound, which is for the answer, not for the way to it."""
        problem = self.problem
        options: dict[str, Any] = {"seed": self.seed, "throw": False, "method": "auto" if proven else "columns"}
        options |= {"known": problem.scaled(np.asarray(problem.known)), "about": problem.about_indices.tolist()}
        if not isinstance(self.problem.criterion, MinEigenvalue):
            options["criterion"] = self.problem.criterion
        if self.rules:
            options |= {"rules": self.rules, "segments": self.rule_segments(path)}
        return select_sensors(self.blocks(path), self.per_segment, **options)

    def criterion_value(self, path: Trajectory, chosen: np.ndarray) -> float:
        """Return the criterion of what is known and what a schedule sees along a path."""
        return self.problem.criterion_value(schedule_information(segment_information(self.problem.system, path, self.segments), chosen))

    def value_of(self, path: Trajectory, chosen: np.ndarray, penalty: float) -> float:
        """Return the criterion of what is known and what a schedule sees along a path, less what its switching takes."""
        return self.criterion_value(path, chosen) - penalty

    def switching_penalty(self, path: Trajectory, schedule: Schedule) -> float:
        """Return what switching takes off the value of a schedule selected on that path; on any other path it is the same."""
        return self.criterion_value(path, schedule.chosen) - schedule.value if self.rules else 0.0

    def recorded_value(self, path: Trajectory, schedule: Schedule, penalty: float) -> float:  # the schedule's own
        """Return the schedule's value."""
        return schedule.value

    def certify_chosen(self, path: Trajectory, chosen: np.ndarray, value: float, best: Schedule) -> Schedule:
        """Return the record of a schedule (K, S) of that value under the bound of the best one found for the path."""
        gap = gap_of(value, max(best.bound, value), self.problem.criterion)
        status = Status.OPTIMAL if best.status is Status.OPTIMAL and gap <= best.gap else best.status
        return replace(best, chosen=chosen, value=value, gap=gap, status=status)
