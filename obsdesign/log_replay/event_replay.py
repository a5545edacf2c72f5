"""A log, from event to event: how well could any filter have done, how well did this one, and what mattered when."""

from __future__ import annotations

from collections.abc import Sequence
from logging import getLogger

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count, require_known, require_positive
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.errors import InputError
from obsdesign.estimation.abstract import AbstractEstimator
from obsdesign.estimation.estimate import Estimate
from obsdesign.estimation.extended_kalman_filter import ExtendedKalmanFilter
from obsdesign.estimation.gate import Gate
from obsdesign.estimation.log_run import estimate_log
from obsdesign.log_replay.event_path import Along, DrivenPath, driven_path, longest_gap
from obsdesign.log_replay.log_schedule import active_log
from obsdesign.log_replay.misfits import misfit_notes
from obsdesign.log_replay.question import ReplayQuestion
from obsdesign.log_replay.rank_correlation import rank_correlation
from obsdesign.log_replay.replay_result import LockOut, Replay, ReplayWindow
from obsdesign.log_replay.window_replay import replay_windows
from obsdesign.logs.log import Log
from obsdesign.logs.truth import errors_against
from obsdesign.noise_density import DisturbancePsd, InputPsd
from obsdesign.prior import Prior
from obsdesign.progress import Progress, StageReport
from obsdesign.round_off import standard_deviations
from obsdesign.selection.posterior.filter_schedule import FilterSchedule

_LOGGER = getLogger(__name__)


@validate_arguments
def replay(
    system: AbstractSystem,
    log: Log,
    prior: Prior,
    *,
    disturbance_psd: DisturbancePsd = None,
    input_psd: InputPsd = None,
    gate: float | None = 0.999,
    window: float = 10.0,
    about: Sequence[str] = ("x", "y"),
    along: Along = "estimate",
    restarts: int = 0,
    active: FilterSchedule | Sequence[str] | np.ndarray | None = None,
    estimator: AbstractEstimator | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Replay:
    """Run a filter on a log and say what could have been known: bound, error, and by windows what was hidden and what mattered.

    The bound is the posterior information at the events, with the samples that arrived, J of `posterior_information`. What a sensor is
    worth in a window is by how much the prediction grows without its samples, given what was known before.

    Arguments:
        system: vehicle and sensors.
        log: the recorded run; its truth judges, and is not looked at by the filter.
        prior: what is known of the state at the log's beginning; with restarts about the state at the beginning of each window.
        disturbance_psd: power spectral density (n,) or (n, n) of the process noise [unit^2/s], Q = psd dt; None = none. Or a PerSpeed.
        input_psd: of known inputs, as for posterior_information; None = none.
        gate: share of the samples that the filter takes in where all is as modelled, in (0, 1): a Gate; None = it takes in all.
        window: length of a window [s].
        about: names of the states that count.
        along: where information is taken: along the filter's "estimate", or along the "truth" of the log, which is the estimate where
            that says nothing.
        restarts: how many filters begin anew in each window, at draws of the prior about the path there: errors are theirs, and
            predictions are made from the same prior; 30 tell an error well. 0 = windows of the one run. Without truth there are none.
        active: which samples count: a schedule, names of sensors, or (K,) bool for the log's samples in order of time; None = all.
        estimator: what runs, with a gate of its own; None = an ExtendedKalmanFilter with the gate.
        seed: of the draws.
        progress: is called with what is being done, as it begins; None = nobody is told.
    Raises InputError for values outside these ranges, and as estimate_log.
    """
    _require_options(system, window, about, restarts, seed)
    chosen = estimator or ExtendedKalmanFilter(gate=None if gate is None else Gate(gate))
    used = log if active is None else active_log(log, active)
    question = ReplayQuestion(system, used, prior, disturbance_psd, input_psd, chosen, tuple(about))
    report = StageReport(_LOGGER, progress)
    report("the filter along the log")
    run = estimate_log(system, used, prior, disturbance_psd=disturbance_psd, input_psd=input_psd, estimator=chosen)
    driven = driven_path(question, run, along)
    J = driven.posterior(question, prior, 0, len(run.t) - 1)
    error = _errors(question, run)
    report("what the windows see")
    windows = replay_windows(question, driven, run, error, J, window=window, restarts=restarts, seed=seed, report=report)
    return _assemble(question, driven, run, standard_deviations(J), error, windows)


def rmse_with(question: ReplayQuestion, log: Log) -> float:
    """Return the RMSE of what counts, of a question's filter on another log of the same run; nan without truth."""
    run = estimate_log(
        question.system,
        log,
        question.prior,
        disturbance_psd=question.disturbance_psd,
        input_psd=question.input_psd,
        estimator=question.estimator,
    )
    return _rms(np.sqrt((_errors(question, run)[:, question.places] ** 2).sum(axis=1)))


def _assemble(
    question: ReplayQuestion, driven: DrivenPath, run: Estimate, bound: np.ndarray, error: np.ndarray, windows: tuple[ReplayWindow, ...]
) -> Replay:
    actual, predicted, plain, own = (
        np.array([getattr(window, name) for window in windows if window.samples.any()]) for name in ("error", "predicted", "plain", "own")
    )
    lengths = np.sqrt((error[:, question.places] ** 2).sum(axis=1))
    is_judged = np.isfinite(actual) & np.isfinite(predicted) & (predicted > 0) if len(actual) else np.zeros(0, dtype=bool)
    ratio = float(np.median(actual[is_judged] / predicted[is_judged])) if is_judged.any() else float("nan")
    return Replay(
        t=run.t,
        estimate=run.mean,
        covariance=run.covariance,
        bound=bound,
        error=error,
        innovations=run.innovations,
        windows=windows,
        rmse=_rms(lengths),
        rmse_second_half=_rms(lengths[run.t > np.mean(question.log.span)]),
        ratio=ratio,
        rank_correlation=rank_correlation(predicted, actual),
        rank_correlation_plain=rank_correlation(plain, actual),
        rank_correlation_own=rank_correlation(own, actual),
        locked_out=lock_outs(run),
        notes=(*question.log.notes, *driven.notes, *run.notes, *misfit_notes(question, driven, run), *_window_notes(question, windows)),
        run=run,
        path=driven.nodes,
        question=question,
    )


def _require_options(system: AbstractSystem, window: float, about: Sequence[str], restarts: int, seed: int) -> None:
    require_positive("window", window)
    require_count("restarts", restarts, minimum=0)
    require_count("seed", seed, minimum=0)
    if not about:
        raise InputError("about is empty: name one state at least")
    require_known("about: the system", tuple(about), system.model.state_names)


def _errors(question: ReplayQuestion, run: Estimate) -> np.ndarray:
    truth = question.log.truth
    if truth is None:
        return np.full(run.mean.shape, np.nan)
    return errors_against(truth, run.states, question.angles, run.t, run.mean, longest_gap(truth.t))


def _rms(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def lock_outs(run: Estimate) -> tuple[LockOut, ...]:
    """Return from when to when the filter of a run was locked out of a sensor: until an alarm, since rejections outnumbered the rest."""
    return tuple(stretch for s in np.flatnonzero(run.alarms.any(axis=0)) for stretch in _lock_outs_of(run, int(s)))


def _lock_outs_of(run: Estimate, s: int) -> list[LockOut]:
    result, count, first = [], 0, 0.0
    for k in np.flatnonzero(run.arrived[:, s] & ~run.unusable[:, s]):
        is_out = bool(run.rejected[k, s] or run.alarms[k, s])
        first = float(run.t[k]) if is_out and not count else first
        count = max(count + (1 if is_out else -1), 0)
        if run.alarms[k, s]:
            result.append(LockOut(run.sensors[s], first, float(run.t[k])))
            count = 0
    return result


def _window_notes(question: ReplayQuestion, windows: tuple[ReplayWindow, ...]) -> tuple[str, ...]:
    silent = sum(not window.samples.any() for window in windows)
    without_samples = f"{silent} of {len(windows)} windows have no sample" if silent else ""
    without_truth = "" if question.log.truth else "there is no truth: windows are ranked, but by how much errors exceed is not told"
    return tuple(filter(None, (without_samples, without_truth)))
