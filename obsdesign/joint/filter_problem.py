"""Path and schedule for what a filter knows on the way or at the end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.criteria.posterior import Posterior
from obsdesign.errors import InputError
from obsdesign.joint.abstract import AbstractJointProblem
from obsdesign.selection.posterior.deadline import NEVER
from obsdesign.selection.posterior.filter_certificate import certify_schedule
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.posterior.filter_selection import select_for_filter, solve_question
from obsdesign.selection.posterior.formulation import formulate
from obsdesign.selection.posterior.options import build_options
from obsdesign.selection.posterior.problem import PosteriorProblem
from obsdesign.selection.posterior.questions import FilterQuestion, FilterSettings, build_question
from obsdesign.selection.problem import switching_cost
from obsdesign.trajectory import Trajectory

_GAP = 1e-3  # of the answer's schedule, that of `select_for_filter`
_GAP_ON_THE_WAY = 1e-2


@dataclass(frozen=True, eq=False)
class FilterJointProblem(AbstractJointProblem[FilterSchedule]):
    """max -C(p, s), or 1 / C of a smallest eigenvalue, C the cost of `Posterior` with the samples of a schedule, plus what switching costs.

    Over paths p of a problem and schedules s (K, S) that keep the rules: the same C as that of `select_for_filter`.
    Raises InputError for a problem that schedules cannot answer, and for counts that do not fit it.
    """

    def require_criterion(self) -> None:
        """Raise InputError for another criterion than `Posterior`."""
        if not isinstance(self.problem.criterion, Posterior):
            kind = type(self.problem.criterion).__name__
            raise InputError(f"codesign: the question is 'filter' and the criterion {kind}: must be Posterior, or the question 'start'")

    @property
    def posterior(self) -> Posterior:
        """The problem's criterion."""
        criterion = self.problem.criterion
        if not isinstance(criterion, Posterior):
            raise AssertionError("another criterion was refused")
        return criterion

    def require_information(self, path: Trajectory) -> None:
        """Raise InputError for a path along which samples have no information."""
        self.problem.value(path)

    def select_schedule(self, path: Trajectory, proven: bool = False) -> FilterSchedule:
        """Return the best schedule found for a path; proven: by `select_for_filter`, with others to compare, else to a wider gap."""
        if not proven:
            return solve_question(*self._formulation(path), gap=_GAP_ON_THE_WAY, deadline=NEVER)
        criterion, problem = self.posterior, self.problem
        return select_for_filter(
            problem.system,
            path,
            criterion.prior,
            self.per_segment,
            segment=self._boundaries(path),
            disturbance_psd=criterion.disturbance_psd,
            input_psd=criterion.input_psd,
            unknown_inputs=criterion.unknown_inputs,
            about=problem.about or None,
            over=criterion.over,
            criterion=criterion.criterion,
            scale=problem.units,
            rules=self.rules,
            gap=_GAP,
            seed=self.seed,
            throw=False,
        )

    def value_of(self, path: Trajectory, chosen: np.ndarray, penalty: float) -> float:
        """Return the posterior's value of the samples that a schedule has, its switching counted as so much more cost."""
        value = self.with_schedule(chosen).value(path)
        if not penalty:
            return value
        return value / (1 + penalty * value) if self.posterior.is_smallest_eigenvalue else value - penalty

    def switching_penalty(self, path: Trajectory, schedule: FilterSchedule) -> float:
        """Return what the switching-ons of a schedule cost."""
        return switching_cost(self.rules, self.rule_segments(path), schedule.chosen) if self.rules else 0.0

    def recorded_value(self, path: Trajectory, schedule: FilterSchedule, penalty: float) -> float:
        """Return the posterior's value of the two, recomputed."""
        return self.value_of(path, schedule.chosen, penalty)

    def certify_chosen(self, path: Trajectory, chosen: np.ndarray, value: float, best: FilterSchedule) -> FilterSchedule:
        """Return the record of a schedule (K, S) under the bound of the best one found for the path."""
        if np.array_equal(chosen, best.chosen):
            return best
        schedule = certify_schedule(*self._formulation(path), chosen, best, gap=_GAP)
        if schedule is None:
            raise AssertionError("the schedule of a pair keeps the rules")
        return schedule

    def _formulation(self, path: Trajectory) -> tuple[FilterQuestion, PosteriorProblem]:
        """Return what is asked of schedules for a path, and the problem that methods work on."""
        criterion, problem = self.posterior, self.problem
        settings = FilterSettings(
            segment=self._boundaries(path),
            disturbance_psd=criterion.disturbance_psd,
            input_psd=criterion.input_psd,
            unknown_inputs=criterion.unknown_inputs,
            about=problem.about or None,
            over=criterion.over,
            criterion=criterion.criterion,
            scale=problem.units,
            active=None,
            floor=None,
        )
        question = build_question(problem.system, path, criterion.prior, settings)
        options = build_options(self.rules, self.per_segment, question.segments, question.answers)
        return formulate(question, options)

    def _boundaries(self, path: Trajectory) -> list[float]:
        """Return when segments begin and end (K+1,) [s]."""
        return path.t[:: path.steps // self.segments].tolist()
