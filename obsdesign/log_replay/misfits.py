"""The sensor that contradicts all others: a beacon that was moved, a clock that is off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from obsdesign.dynamics.per_step import PerStepSystem
from obsdesign.dynamics.process_noise import noise_of
from obsdesign.errors import InputError
from obsdesign.estimation.estimate import Estimate
from obsdesign.estimation.filter_bank import Belief, FilterBank
from obsdesign.log_replay.event_path import DrivenPath
from obsdesign.log_replay.question import ReplayQuestion

_SUSPICIOUS = 1.5  # normalised squares over their number of outputs, on average
_REJECTED_SHARE = 0.05  # of a sensor's samples
_CLEARED = 0.6  # what the contradictions of the others must fall to when one is left out
_MAX_STEPS = 20_000  # of the log, its first ones


def misfit_notes(question: ReplayQuestion, driven: DrivenPath, estimate: Estimate) -> tuple[str, ...]:
    """Return a sentence that names the sensor without which the others agree with each other and the motion, where there is one.

    A filter for each sensor runs without it, none with a gate. Only where innovations are larger than they should be.
    """
    if not _is_suspicious(estimate) or len(estimate.sensors) < 2:
        return ()
    with_all, without = _contradictions(question, driven)
    if not np.isfinite(without).any():
        return ()
    s = int(np.nanargmin(without / with_all))
    if not without[s] < _CLEARED * with_all[s]:
        return ()
    return (
        f"{estimate.sensors[s]} does not fit the others: without it their squared innovations are {without[s]:.2g} times what is expected,"
        f" with it {with_all[s]:.2g} times; it may stand elsewhere, or measure something else",
    )


def _is_suspicious(estimate: Estimate) -> bool:
    counts = np.maximum(estimate.arrived.sum(axis=0), 1)
    if (estimate.rejected.sum(axis=0) > _REJECTED_SHARE * counts).any():
        return True
    ratios = (estimate.innovations / estimate.innovation_std) ** 2
    return bool(np.isfinite(ratios).any()) and float(np.nanmean(ratios)) > _SUSPICIOUS


def _contradictions(question: ReplayQuestion, driven: DrivenPath) -> tuple[np.ndarray, np.ndarray]:
    """Return mean squared innovations of all other sensors over what is expected of them (S,), with each sensor and without."""
    model, events = question.system.model, driven.events
    steps, sensors, owner = slice(0, min(len(events.y), _MAX_STEPS)), len(model.channels), list(model.output_owner)
    noise = noise_of(model, question.disturbance_psd, question.input_psd, 1.0)
    bank = FilterBank(PerStepSystem(question.system, has_arrived=True), 1.0, noise, estimator=replace(question.estimator.filter, gate=None))
    is_on = np.vstack([np.ones(sensors), 1.0 - np.eye(sensors)])
    active = (driven.weights[steps, None] * is_on)[..., owner]
    runs = sensors + 1
    start = Belief(np.tile(question.prior.mean, (runs, 1)), np.tile(question.prior.covariance, (runs, 1, 1)))
    try:
        reports = bank.report(start, events.rows[steps], np.repeat(events.y[steps, None], runs, axis=1), active)[1]
    except InputError:  # a filter ran away
        return np.full(sensors, np.nan), np.full(sensors, np.nan)
    variance = np.where(reports.is_usable & (active > 0) & (reports.variance > 0), reports.variance, np.nan)
    ratios = reports.residual**2 / variance
    of_others = np.array([[s != k for k in owner] for s in range(sensors)])
    with_all = np.array([_mean(ratios[:, 0][:, chosen]) for chosen in of_others])
    return with_all, np.array([_mean(ratios[:, s + 1][:, chosen]) for s, chosen in enumerate(of_others)])


def _mean(values: np.ndarray) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")
