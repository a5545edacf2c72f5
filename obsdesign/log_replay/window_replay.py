"""The windows of a log: what was predicted in each, what happened, what was hidden, and what mattered."""

from __future__ import annotations

import numpy as np

from obsdesign.estimation.estimate import Estimate
from obsdesign.log_replay.event_path import DrivenPath, longest_gap
from obsdesign.log_replay.hidden_states import hidden_in_windows
from obsdesign.log_replay.question import ReplayQuestion
from obsdesign.log_replay.replay_result import ReplayWindow
from obsdesign.log_replay.restarts import RestartedFilters
from obsdesign.log_replay.window_models import window_models
from obsdesign.progress import StageReport
from obsdesign.round_off import visibility_of_sum

Sizes = tuple[float, float, float]  # error, prediction, and what the filter itself expects


def replay_windows(
    question: ReplayQuestion,
    driven: DrivenPath,
    run: Estimate,
    error: np.ndarray,
    J: np.ndarray,
    *,
    window: float,
    restarts: int,
    seed: int,
    report: StageReport,
) -> tuple[ReplayWindow, ...]:
    """Return the windows of `window` seconds; J (N+1, n, n) along the whole path, error (N+1, n)."""
    bounds = window_bounds(driven.path.t, window)
    counts = np.add.reduceat(driven.events.arrived, bounds[:-1], axis=0, dtype=int)
    filters = _restarted_filters(question, driven, restarts, seed)
    models, priors = window_models(question, driven, bounds), np.tile(question.prior.covariance, (len(bounds) - 1, 1, 1))
    growth = models.growth(priors if filters else models.chained_priors(question.prior.covariance), question)
    gramians = models.gramians
    hidden = hidden_in_windows(question.system, gramians, counts, driven.path.x[bounds[:-1]], question.prior.std)
    windows = []
    for k, (first, last) in enumerate(zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True)):
        if filters is not None:
            report(f"{k} of {len(bounds) - 1} windows done, the next with filters begun anew")
        sizes = _sizes(question, run, error, J, first, last) if filters is None else _restarted_sizes(filters, counts[k], first, last)
        plain = float(np.sqrt((visibility_of_sum(gramians[k]).std[question.places] ** 2).sum()))
        t = float(driven.path.t[first]), float(driven.path.t[last])
        windows.append(ReplayWindow(*t, counts[k], *sizes, plain, gramians[k], hidden[k], growth[k]))
    return tuple(windows)


def window_bounds(t: np.ndarray, window: float) -> np.ndarray:
    """Return the events (K+1,) at which windows of so many seconds begin and end; the last is shorter by half of it at most, or longer."""
    count = max(round(float(t[-1] - t[0]) / window), 1)
    places = np.searchsorted(t, t[0] + window * np.arange(count))
    return np.unique(np.append(places[np.append(True, t[places[1:]] > t[0])], len(t) - 1))


def _restarted_filters(question: ReplayQuestion, driven: DrivenPath, restarts: int, seed: int) -> RestartedFilters | None:
    truth, model = question.log.truth, question.system.model
    if truth is None or not restarts:
        return None
    values, states = truth.at(driven.path.t, question.angles, longest_gap(truth.t)), np.full(driven.path.x.shape, np.nan)
    for column, name in enumerate(truth.names):
        if name in model.state_names:
            states[:, model.state_names.index(name)] = values[:, column]
    draws = np.random.default_rng(seed).standard_normal((restarts, len(model.states))) @ np.linalg.cholesky(question.prior.covariance).T
    return RestartedFilters(question, driven, states, draws)


def _sizes(question: ReplayQuestion, run: Estimate, error: np.ndarray, J: np.ndarray, first: int, last: int) -> Sizes:
    """Of the one run, between two events."""
    squares = (error[first:last, question.places] ** 2).sum(axis=1)
    actual = float(np.sqrt(np.nanmean(squares))) if np.isfinite(squares).any() else float("nan")
    return actual, question.rms_of(_covariances(question, J[first:last])), question.rms_of(run.covariance[first:last])


def _restarted_sizes(filters: RestartedFilters, counts: np.ndarray, first: int, last: int) -> Sizes:
    """Of filters that begin anew, from the prior."""
    if not counts.any():
        return float("nan"), float("nan"), float("nan")
    actual, own = filters.errors(first, last)
    J = filters.driven.posterior(filters.question, filters.question.prior, first, last)
    return actual, filters.question.rms_of(_covariances(filters.question, J[:-1])), own


def _covariances(question: ReplayQuestion, J: np.ndarray) -> np.ndarray:
    """J^-1, in units of the prior's standard deviations for the sake of rounding."""
    unit = question.prior.std[:, None] * question.prior.std
    return np.linalg.inv(J * unit) * unit
