"""What is asked of a path and a schedule, and what one of the two needs to know of the other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Generic

import numpy as np

from obsdesign.checks import require_count, require_divisor
from obsdesign.design.problem import DesignProblem
from obsdesign.dynamics.path_segments import segments_along
from obsdesign.errors import InputError
from obsdesign.joint.result import AnySchedule
from obsdesign.rules.abstract import AbstractRule, Segments
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class AbstractJointProblem(ABC, Generic[AnySchedule]):
    """max value(p, s) - price(p) over paths p of a problem and schedules s (K, S) that keep the rules, at most per_segment at a time.

    The value of the two is that of the problem's criterion, less what switching takes.
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
        self.require_criterion()
        self._require_plain()

    def _require_plain(self) -> None:
        """Raise InputError for what the selection of sensors does not know of."""
        problem = self.problem
        unsupported = {"floor": problem.floor, "robust": problem.robust, "weights": problem.weights is not None}
        for name, value in unsupported.items():
            if value:
                raise InputError(f"codesign: the problem has {name}, which a selection of sensors does not know of: must be left out")

    @abstractmethod
    def require_criterion(self) -> None:
        """Raise InputError for a criterion that such schedules are not judged by."""

    @abstractmethod
    def require_information(self, path: Trajectory) -> None:
        """Raise InputError for a path along which samples have no information, such as one that meets a landmark."""

    @abstractmethod
    def select_schedule(self, path: Trajectory, proven: bool = False) -> AnySchedule:
        """Return the best schedule found for a path; proven: with the whole search, which is for the answer, not for the way to it."""

    @abstractmethod
    def value_of(self, path: Trajectory, chosen: np.ndarray, penalty: float) -> float:
        """Return the value of a path and a schedule (K, S) of which the switching takes so much."""

    @abstractmethod
    def switching_penalty(self, path: Trajectory, schedule: AnySchedule) -> float:
        """Return what switching takes, of a schedule selected on that path; on any other path it is the same."""

    @abstractmethod
    def recorded_value(self, path: Trajectory, schedule: AnySchedule, penalty: float) -> float:
        """Return the value as the answer has it, of a schedule certified for the path."""

    @abstractmethod
    def certify_chosen(self, path: Trajectory, chosen: np.ndarray, value: float, best: AnySchedule) -> AnySchedule:
        """Return the record for a path of a schedule (K, S) of that value, given the best one found there, which is no better."""

    def with_schedule(self, chosen: np.ndarray) -> DesignProblem:
        """Return the problem of the path for a schedule (K, S)."""
        return replace(self.problem, weights=chosen.astype(float))

    def rule_segments(self, path: Trajectory) -> Segments:
        """Return what rules know of a path: names, times and places."""
        return segments_along(self.problem.system.model, path, np.arange(self.segments + 1) * (path.steps // self.segments))

    def allows(self, path: Trajectory, chosen: np.ndarray) -> bool:
        """Whether a schedule that keeps the rules on another path does so on this one: only where sensors work depends on that."""
        segments = self.rule_segments(path)
        availabilities = (rule.terms(segments).available for rule in self.rules)
        return all(available is None or not (chosen & ~available).any() for available in availabilities)

    def path_price(self, path: Trajectory) -> float:
        """Return the prices of a path."""
        return self.problem.price(path)
