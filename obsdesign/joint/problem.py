"""What is asked of a path and a schedule, and what one of the two needs to know of the other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from obsdesign.checks import require_count, require_divisor
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.design.problem import DesignProblem
from obsdesign.dynamics.path_segments import segments_along
from obsdesign.errors import InputError
from obsdesign.information.accumulation import segment_information
from obsdesign.rules.abstract import AbstractRule, Segments
from obsdesign.selection.schedule import Schedule, schedule_information
from obsdesign.selection.solver import select_sensors
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class JointProblem:
    """max criterion(S (known + sum_ks s_ks W_ks(p)) S) over paths p of a problem and schedules s (K, S) that keep the rules.

    Of the states that the problem judges, the others being found as well.
    Raises InputError for a problem that schedules cannot answer, and for counts that do not fit it.
    """

    problem: DesignProblem
    segments: int
    per_segment: int
    rules: tuple[AbstractRule, ...]
    seed: int
    rounds: int

    def __post_init__(self) -> None:
        problem = self.problem
        if problem.shortest != problem.longest:
            raise InputError(f"codesign: the duration is ({problem.shortest:g}, {problem.longest:g}): must be one number of seconds")
        require_divisor("segments", self.segments, "steps", problem.steps)
        require_count("per_segment", self.per_segment, maximum=len(problem.system.model.channels))
        require_count("seed", self.seed, minimum=0)
        require_count("rounds", self.rounds)
        if problem.criterion.knowledge is not None:
            kind = type(problem.criterion).__name__
            raise InputError(f"codesign: {kind} is not additive over sensors: must be a criterion of the samples' information alone")
        self._require_plain()

    def _require_plain(self) -> None:
        """Raise InputError for what the selection of sensors does not know of."""
        problem = self.problem
        unsupported = {"floor": problem.floor, "robust": problem.robust, "weights": problem.weights is not None}
        for name, value in unsupported.items():
            if value:
                raise InputError(f"codesign: the problem has {name}, which a selection of sensors does not know of: must be left out")

    def with_schedule(self, chosen: np.ndarray) -> DesignProblem:
        """Return the problem of the path for a schedule (K, S)."""
        return replace(self.problem, weights=chosen.astype(float))

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

    def rule_segments(self, path: Trajectory) -> Segments:
        """Return what rules know of a path: names, times and places."""
        return segments_along(self.problem.system.model, path, np.arange(self.segments + 1) * (path.steps // self.segments))

    def allows(self, path: Trajectory, chosen: np.ndarray) -> bool:
        """Whether a schedule that keeps the rules on another path does so on this one: only where sensors work depends on that."""
        segments = self.rule_segments(path)
        availabilities = (rule.terms(segments).available for rule in self.rules)
        return all(available is None or not (chosen & ~available).any() for available in availabilities)

    def criterion_value(self, path: Trajectory, chosen: np.ndarray) -> float:
        """Return the criterion of what is known and what a schedule sees along a path."""
        return self.problem.criterion_value(schedule_information(segment_information(self.problem.system, path, self.segments), chosen))

    def switching_penalty(self, path: Trajectory, schedule: Schedule) -> float:
        """Return what switching takes off the value of a schedule selected on that path; on any other path it is the same."""
        return self.criterion_value(path, schedule.chosen) - schedule.value if self.rules else 0.0

    def path_price(self, path: Trajectory) -> float:
        """Return the prices of a path."""
        return self.problem.price(path)
