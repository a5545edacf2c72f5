"""What a log says: estimates beside what could have been known, window by window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from obsdesign.criteria.abstract import AbstractCriterion, Over
from obsdesign.display import AbstractDisplay, Summary, number
from obsdesign.estimation.estimate import Estimate
from obsdesign.log_replay.log_schedule import ScheduleOptions, schedule_of_log
from obsdesign.log_replay.question import ReplayQuestion
from obsdesign.log_replay.rank_correlation import RankCorrelation
from obsdesign.rules.abstract import AbstractRule
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class ReplayWindow:
    """A stretch of a log: how large the error was and had to be, what stayed hidden, and which sensor it hung on.

    Errors are root mean squares over the window of the length of what counts, such as (x, y), in the unit of those states.
    """

    first: float
    """When it begins [s]."""
    last: float
    """When it ends [s]."""
    samples: np.ndarray
    """How many samples of each sensor arrived (S,)."""
    error: float
    """Of the estimate, against the truth; nan where that is not known."""
    predicted: float
    """What no unbiased filter is below: of the posterior information."""
    own: float
    """What the filter itself expected."""
    plain: float
    """Of the samples of the window alone, about the state at its beginning; inf where something of that is hidden."""
    gramian: np.ndarray
    """What these samples say of that state (n, n), in 1/(unit_i unit_j)."""
    hidden: str
    """What the samples that arrived do not see, in words; "" where they see all."""
    growth: np.ndarray
    """By what factor the prediction grows without each sensor (S,): 1 for one that adds nothing."""


@dataclass(frozen=True, eq=False)
class LockOut:
    """A time in which a filter rejected what a sensor said and was wrong itself."""

    sensor: str
    """Whose samples were rejected."""
    first: float
    """When the rejections began [s]."""
    last: float
    """When the gate noticed, and let the sensor in again [s]."""


@dataclass(frozen=True, eq=False)
class Replay(AbstractDisplay):
    """What a log says of the state along N events: estimate, bound, error, and the same by windows.

    Values at t_k are after the samples of that instant, predicted at t_N; several samples of a sensor at one time are on instants of
    their own. Ranking windows needs no truth; the factor between what happened and what was predicted does.
    """

    t: np.ndarray
    """Instants (N+1,) [s]."""
    estimate: np.ndarray
    """Estimated states (N+1, n), in their units."""
    covariance: np.ndarray
    """Covariance (N+1, n, n) of their errors by the filter itself, in the units of the states."""
    bound: np.ndarray
    """Cramer-Rao bound (N+1, n): standard deviations that no unbiased filter is below, in the units of the states."""
    error: np.ndarray
    """Estimate minus truth (N+1, n), in the units of the states, angles wrapped; nan where the truth is not known."""
    innovations: np.ndarray
    """Residuals (N, q) of the outputs before the samples are taken in, in their units; nan without a sample."""
    windows: tuple[ReplayWindow, ...]
    """The stretches of the log."""
    rmse: float
    """Root mean square over all instants of the error of what counts, in the unit of those states; nan without truth."""
    rmse_second_half: float
    """The same over the second half of the time: what was calibrated on the first half is judged by it."""
    ratio: float
    """Median over the windows of the error over the prediction; nan without truth."""
    rank_correlation: RankCorrelation
    """Of the predictions of windows with their errors."""
    rank_correlation_plain: RankCorrelation
    """Of what the windows' samples alone predict."""
    rank_correlation_own: RankCorrelation
    """Of what the filter itself expected."""
    locked_out: tuple[LockOut, ...]
    """When the gate kept a sensor out and the filter was wrong."""
    notes: tuple[str, ...]
    """What else is to be said, in words."""
    run: Estimate
    """The filter's run on the log: normalised squares, which samples arrived, which were rejected."""
    path: Trajectory
    """Along which the bound is, each time once."""
    question: ReplayQuestion
    """What was asked."""

    @property
    def rejections(self) -> int:
        """How many samples the gate kept out."""
        return int(self.run.rejected.sum())

    @property
    def hidden_windows(self) -> tuple[ReplayWindow, ...]:
        """The windows whose samples do not see all of the state."""
        return tuple(window for window in self.windows if window.hidden)

    def schedule(
        self,
        per_segment: int = 1,
        segment: float = 10.0,
        *,
        step: float | None = None,
        over: Over = "mean",
        criterion: AbstractCriterion | None = None,
        rules: Sequence[AbstractRule] = (),
        gap: float = 1e-3,
        time_limit: float | None = None,
        seed: int = 0,
    ) -> FilterSchedule:
        """Choose which sensors to be on when, of the samples that arrived, so that a filter knows most of what counts.

        Samples count each at its own time; the path is taken at equal steps.

        Arguments:
            per_segment: how many sensors may be on at a time.
            segment: length of a segment [s].
            step: of the path [s], of which the segment is a whole multiple; None = a twentieth of the segment.
            over: which instants count, as for select_for_filter.
            criterion: what the covariance is judged by, as for select_for_filter.
            rules: what schedules have to keep, as for select_for_filter.
            gap: how near to the best the schedule is to be proven, as for select_for_filter.
            time_limit: after which the search ends [s]; None = never.
            seed: of the random schedules that are compared.
        Raises InputError as select_for_filter.
        """
        grid = segment / 20 if step is None else step
        options = ScheduleOptions(per_segment, segment, grid, over, criterion, tuple(rules), gap, time_limit, seed)
        return schedule_of_log(self.question, self.path, options)

    def _summary(self) -> Summary:
        correlation, about = self.rank_correlation, ", ".join(self.question.about)
        rows = [
            ("samples", f"{len(self.question.log.samples.t)}, {self.rejections} rejected by the gate"),
            (f"RMSE of {about}", f"{number(self.rmse)}, {number(self.rmse_second_half)} in the second half"),
            ("windows", f"{len(self.windows)}, {len(self.hidden_windows)} of which do not see all"),
            ("rank correlation", f"{number(correlation.value)} ({number(correlation.low)} to {number(correlation.high)})"),
            ("error over prediction", number(self.ratio)),
            *(("note", note) for note in self.notes),
        ]
        return Summary(f"replay of {number(float(self.t[-1] - self.t[0]), 's')}", tuple(rows))
