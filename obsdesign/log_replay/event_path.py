"""The path along which a log is judged, with an instant for each event: that of the truth, or that of a filter's estimate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from obsdesign.dynamics.per_step import PerStepSystem
from obsdesign.errors import InputError
from obsdesign.estimation.estimate import Estimate
from obsdesign.estimation.log_run import path_of_estimate, sensor_weights
from obsdesign.information.posterior import disturbance_of, information_along
from obsdesign.log_replay.question import ReplayQuestion
from obsdesign.logs.events import Events, events_of
from obsdesign.logs.log import Log
from obsdesign.prior import Prior
from obsdesign.trajectory import Trajectory, uneven_path_of

Along = Literal["truth", "estimate"]
_WORTH_SAYING = 0.01  # of the time
_GAP, _SHORTEST_GAP = 5.0, 1.0  # of the median distance of true values, and seconds: beyond both the truth is not known between two


@dataclass(frozen=True, eq=False)
class DrivenPath:
    """The events of a log, the path through them, and how often each sensor's sample counts at each (N, S).

    nodes: the path with each time once, behind all samples of it. notes: where its states are from, in words.
    """

    events: Events
    path: Trajectory
    nodes: Trajectory
    weights: np.ndarray
    notes: tuple[str, ...]

    def posterior(self, question: ReplayQuestion, prior: Prior, first: int, last: int) -> np.ndarray:
        """Return J (last - first + 1, n, n) from event `first` on, where the prior holds, to event `last`, whose samples are not in it."""
        nodes, held = slice(first, last + 1), slice(first, last)
        whole, per_step = self.path, PerStepSystem(question.system, has_arrived=True)
        part = uneven_path_of(whole, whole.t[nodes], whole.x[nodes], whole.u[held], None)
        disturbance = disturbance_of(per_step, part, prior, question.disturbance_psd, (), question.input_psd)
        return information_along(per_step, part, prior, disturbance, self.weights[held])


def longest_gap(t: np.ndarray) -> float:
    """Return the longest time between two true values [s] between which the truth is known, of values at t (L,)."""
    return max(_GAP * float(np.median(np.diff(t))), _SHORTEST_GAP) if len(t) > 1 else _SHORTEST_GAP


def driven_path(question: ReplayQuestion, estimate: Estimate, along: Along) -> DrivenPath:
    """Return the path of a log along the truth, where there is none along the estimate, or along the estimate."""
    events = events_of(question.system, question.log)
    nodes = path_of_estimate(question.system, question.log, estimate)
    notes: tuple[str, ...] = ()
    if along == "truth":
        x, notes = _true_states(question, nodes)
        nodes = Trajectory(nodes.t, x, nodes.u)
    place = np.searchsorted(nodes.t, estimate.t)
    path = uneven_path_of(nodes, estimate.t, nodes.x[place], events.u, None)
    return DrivenPath(events, path, nodes, sensor_weights(question.system, events), notes)


def _true_states(question: ReplayQuestion, nodes: Trajectory) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return true states (N+1, n), estimated ones where the truth says nothing, and what is which in words."""
    truth, names = question.log.truth, question.system.model.state_names
    if truth is None or not set(truth.names) & set(names):
        raise InputError("along is 'truth': the log says nothing true of a state; along the filter's own estimate is accepted: 'estimate'")
    x, shares = nodes.x.copy(), {}
    values = truth.at(nodes.t, question.angles, longest_gap(truth.t))
    for column, name in enumerate(truth.names):
        if name in names:
            i, is_known = names.index(name), np.isfinite(values[:, column])
            if name in question.angles and is_known.any():
                turns = np.median(x[is_known, i] - values[is_known, column]) / (2 * np.pi)
                values[:, column] += 2 * np.pi * np.rint(turns)
            x[is_known, i] = values[is_known, column]
            shares[name] = float(np.mean(~is_known))
    notes = [
        f"the truth says nothing of {name} {100 * share:.0f} % of the time: the path has the estimate there"
        for name, share in shares.items()
        if share > _WORTH_SAYING
    ]
    untold = [name for name in names if name not in truth.names]
    if untold:
        notes.append(f"the truth says nothing of {', '.join(untold)}: the path has the estimate of that")
    return x, tuple(notes)


def part_of_log(log: Log, first: float, last: float) -> Log:
    """Return the log with the samples from one time until before another [s], of which there is one at least."""
    chosen = (log.samples.t >= first) & (log.samples.t < last)
    return Log(log.inputs, log.samples.where(chosen), log.truth, log.epoch)
