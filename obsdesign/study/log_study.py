"""From a log to an answer: calibrate on its first part, replay all of it, and choose the sensors that it could have done with."""

from __future__ import annotations

from dataclasses import dataclass
from logging import getLogger

import numpy as np

from obsdesign.blas_threads import one_thread
from obsdesign.calibration.calibration_record import Calibration
from obsdesign.calibration.from_log import calibrate
from obsdesign.errors import InputError
from obsdesign.log_replay.event_path import Along
from obsdesign.log_replay.event_replay import replay, rmse_with
from obsdesign.log_replay.log_schedule import scheduled_log
from obsdesign.log_replay.replay_result import Replay
from obsdesign.progress import Progress, StageReport
from obsdesign.selection.baselines import round_robin
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.study.log_doubts import calibration_doubts
from obsdesign.study.log_setup import LogSetup

_LOGGER = getLogger(__name__)
_RANDOM_SCHEDULES, _FEW = 12, 4  # of a long log few: a filter runs with each
_BEGINNINGS = 4  # of round robin
_MOST_RESTARTED_STEPS = 3_000_000  # filters times events: half a minute
_LONG = 60_000  # events of a log beyond which the proof of a schedule is looked for a limited time
_TIME_LIMIT = 5.0  # s
_LARGE_GROWTH = 3.0  # of a window's error without a sensor: what is larger is all the same


@dataclass(frozen=True, eq=False)
class ScheduleError:
    """What a filter's error came to with the samples of a schedule alone: RMSE of what counts, nan without truth; and its prediction."""

    name: str
    rmse: float


@dataclass(frozen=True, eq=False)
class LogStudy:
    """What was made of a log: its setup, calibration (None: none was asked for), replay, and schedule (None: nothing to choose)."""

    setup: LogSetup
    calibration: Calibration | None
    replay: Replay
    schedule: FilterSchedule | None
    schedule_errors: tuple[ScheduleError, ...]
    notes: tuple[str, ...]

    @property
    def growth(self) -> dict[str, float]:
        """How many times as large errors are predicted without each sensor: mean over the windows with samples, 3 at most of each."""
        names = self.replay.run.sensors
        growths = [np.minimum(window.growth, _LARGE_GROWTH) for window in self.replay.windows if window.samples.any()]
        return dict(zip(names, np.mean(growths, axis=0).tolist() if growths else [1.0] * len(names), strict=True))


@one_thread()
def study_log(setup: LogSetup, seed: int, progress: Progress | None = None) -> LogStudy:
    """Return what a log says; progress: is told what is being done. Raises InputError as calibrate and replay."""
    report = StageReport(_LOGGER, progress)
    calibration = _calibration(setup, report)
    restarts, notes = _restarts(setup)
    drive = _replay(setup, calibration, seed, restarts, report)
    report("a schedule of the samples")
    schedule = log_schedule(setup, drive, seed)
    errors = () if schedule is None else _schedule_errors(drive, schedule, setup.choice.per_segment, seed, report)
    return LogStudy(
        setup,
        calibration,
        drive,
        schedule,
        errors,
        (*drive.notes, *setup.notes, *notes, *_of_calibration(setup, calibration)),
    )


@one_thread()
def schedule_study(setup: LogSetup, seed: int, progress: Progress | None = None) -> LogStudy:
    """Return the schedule of a log, and the one run that it was chosen by; no filters begin anew."""
    report = StageReport(_LOGGER, progress)
    calibration = _calibration(setup, report)
    drive = _replay(setup, calibration, seed, 0, report)
    report("a schedule of the samples")
    schedule = log_schedule(setup, drive, seed)
    if schedule is None:
        raise InputError(f"{setup.file}: nothing to choose: a log of a segment or more is needed, and more sensors than may be on")
    errors = _schedule_errors(drive, schedule, setup.choice.per_segment, seed, report)
    return LogStudy(setup, calibration, drive, schedule, errors, (*drive.notes, *setup.notes, *_of_calibration(setup, calibration)))


def _restarts(setup: LogSetup) -> tuple[int, tuple[str, ...]]:
    """Return how many filters begin anew in each window, none where the log has too many events for that, and say so."""
    wanted, log = setup.settings.restarts, setup.log
    events = len(log.samples.t) + (0 if log.inputs is None else len(log.inputs.t))
    if wanted * events <= _MOST_RESTARTED_STEPS or log.truth is None:
        return wanted, ()
    return 0, (f"windows are those of the one run: for filters begun anew in each the log has many events, about {events}",)


def log_schedule(setup: LogSetup, drive: Replay, seed: int) -> FilterSchedule | None:
    """Return the schedule of a log, None where there is nothing to choose."""
    choice = setup.choice
    if not setup.settings.schedule or len(drive.run.sensors) <= choice.per_segment or drive.t[-1] - drive.t[0] < choice.segment:
        return None
    limit = _TIME_LIMIT if len(drive.t) > _LONG else None
    return drive.schedule(
        choice.per_segment,
        choice.segment,
        over=choice.over,
        criterion=choice.criterion,
        rules=choice.rules,
        gap=choice.gap,
        time_limit=limit,
        seed=seed,
    )


def _calibration(setup: LogSetup, report: StageReport) -> Calibration | None:
    share = setup.settings.calibrate
    if share:
        report(f"calibration on {share:.0%} of the log")
    return calibrate(setup.system, setup.log.first(share), setup.prior) if share else None


def _of_calibration(setup: LogSetup, calibration: Calibration | None) -> tuple[str, ...]:
    """Return what is to be said of a calibration."""
    return () if calibration is None else (*calibration_doubts(setup.system, setup.prior, calibration), *calibration.notes)


def _replay(setup: LogSetup, calibration: Calibration | None, seed: int, restarts: int, report: StageReport) -> Replay:
    settings, truth = setup.settings, setup.log.truth
    has_truth = truth is not None and set(settings.about) <= set(truth.names)
    along: Along = settings.along or ("truth" if has_truth else "estimate")
    return replay(
        setup.system if calibration is None else calibration.system,
        setup.log,
        setup.prior,
        disturbance_psd=setup.disturbance_psd if calibration is None else calibration.disturbance_psd,
        input_psd=setup.input_psd if calibration is None else calibration.input_psd,
        gate=settings.gate,
        window=settings.window,
        about=settings.about,
        along=along,
        restarts=restarts if has_truth else 0,
        seed=seed,
        progress=report.within,
    )


def _schedule_errors(
    drive: Replay, schedule: FilterSchedule, per_segment: int, seed: int, report: StageReport
) -> tuple[ScheduleError, ...]:
    """Return what the filter errs by with all sensors, the chosen schedule, round robin and random ones, where truth tells.

    Round robin is the median over the sensor that it begins with: on one drive these differ as schedules do that are equally good.
    """
    if np.isnan(drive.rmse):
        return ()
    segments, sensors = schedule.chosen.shape
    robins = [np.roll(round_robin(segments, sensors, per_segment), first, axis=1) for first in range(min(sensors, _BEGINNINGS))]
    random, count = np.random.default_rng(seed), _FEW if len(drive.t) > _LONG else _RANDOM_SCHEDULES
    draws = [np.argsort(random.random((segments, sensors)), axis=1) < per_segment for _ in range(count)]
    of_random = list(report.count((_error_with(drive, schedule, draw) for draw in draws), count, "filters with random schedules done"))
    return (
        ScheduleError("all on", drive.rmse),
        ScheduleError("chosen", _error_with(drive, schedule, schedule.chosen)),
        ScheduleError("round robin", float(np.median([_error_with(drive, schedule, robin) for robin in robins]))),
        ScheduleError("random, median", float(np.median(of_random))),
        ScheduleError("random, best", float(np.min(of_random))),
    )


def _error_with(drive: Replay, schedule: FilterSchedule, chosen: np.ndarray) -> float:
    """Return the RMSE of the filter with the samples of a schedule (K, S) alone, over all instants; inf where it loses its way."""
    question = drive.question
    try:
        log = scheduled_log(question.log, chosen, schedule.boundaries, schedule.sensors)
        return rmse_with(question, log)
    except InputError:
        return float("inf")
