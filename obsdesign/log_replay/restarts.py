"""Filters that begin anew in each window, at draws of a prior: how large errors are where it is known how much was known before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.calculus import wrap_columns
from obsdesign.dynamics.per_step import PerStepSystem
from obsdesign.dynamics.process_noise import noise_of
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.log_replay.event_path import DrivenPath
from obsdesign.log_replay.question import ReplayQuestion


@dataclass(frozen=True, eq=False)
class RestartedFilters:
    """R filters for each window, begun at the same R draws (R, n) of the prior about the path's state there."""

    question: ReplayQuestion
    driven: DrivenPath
    truth: np.ndarray
    """True states (N+1, n) at the events, nan where they are not known."""
    draws: np.ndarray

    def errors(self, first: int, last: int) -> tuple[float, float]:
        """Return the root mean square error from event `first` to before `last`, and that which the filters themselves expect."""
        question, events = self.question, self.driven.events
        model, steps = question.system.model, slice(first, last)
        noise = noise_of(model, question.disturbance_psd, question.input_psd, 1.0)
        bank = FilterBank(PerStepSystem(question.system, has_arrived=True), 1.0, noise, estimator=question.estimator)
        runs = len(self.draws)
        start = Belief(self.driven.path.x[first] + self.draws, np.tile(question.prior.covariance, (runs, 1, 1)))
        y = np.repeat(events.y[steps, None], runs, axis=1)
        belief = bank.run(start, events.rows[steps], y, self.driven.weights[steps][:, list(model.output_owner)])
        is_angle = np.array([signal.is_angle for signal in model.states])
        error = belief.mean[:-1] - self.truth[steps][:, None]
        error = wrap_columns(error.reshape(-1, len(is_angle)), is_angle).reshape(error.shape)[..., question.places]
        squares = (error**2).sum(axis=2)
        actual = float(np.sqrt(np.nanmean(squares))) if np.isfinite(squares).any() else float("nan")
        return actual, question.rms_of(belief.covariance[:-1].reshape(-1, *belief.covariance.shape[2:]))
