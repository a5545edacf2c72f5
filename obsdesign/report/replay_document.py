"""The JSON of a replayed log."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from obsdesign.calibration.calibration_record import Calibration
from obsdesign.log_replay.rank_correlation import RankCorrelation
from obsdesign.log_replay.replay_result import ReplayWindow
from obsdesign.report.document_parts import DocumentPart, Number
from obsdesign.study.log_study import LogStudy


class CalibratedPart(DocumentPart):
    """A number of the calibration."""

    value: Number
    low: Number = Field(description="lower end of the 95 % interval")
    high: Number = Field(description="upper end; null: the data set none")
    unit: str
    source: str = Field(description="truth, innovations, or stated: the data do not tell")


class CalibrationPart(DocumentPart):
    """What the first part of the log told."""

    numbers: dict[str, CalibratedPart]
    disturbance_psd: dict[str, float] = Field(description="of each state [unit^2/s]")
    input_psd: dict[str, float] = Field(description="of known inputs [unit^2 s]")
    notes: list[str]


class IntervalPart(DocumentPart):
    """A rank correlation with its 95 % interval by blocks of windows."""

    value: Number
    low: Number
    high: Number
    windows: int


class WindowPart(DocumentPart):
    """A window of the log; errors in the unit of the states that count."""

    first: float
    last: float
    samples: dict[str, int]
    error: Number = Field(description="null: no truth, or no sample")
    predicted: Number = Field(description="of the posterior information")
    own: Number = Field(description="what the filter itself expected")
    plain: Number = Field(description="of the window's samples alone; null: something of the state is hidden")
    hidden: str = Field(description="in words; empty where all is seen")
    growth: dict[str, float] = Field(description="by what factor the prediction grows without each sensor")


class LogSchedulePart(DocumentPart):
    """Which sensors would have done."""

    per_segment: int
    sensors: list[str]
    boundaries: list[float]
    chosen: list[list[int]]
    value: Number
    bound: Number
    gap: Number
    status: str
    rmse: dict[str, Number] = Field(description="of the filter with the samples of each schedule; null: it loses its way")
    notes: list[str]


class LockOutPart(DocumentPart):
    """When the gate kept a sensor out and the filter was wrong."""

    sensor: str
    first: float
    last: float


class ReplayDocument(DocumentPart):
    """What a log says, as `obsdesign replay --json` prints it and replay.json holds it."""

    position_rmse: Number = Field(description="of the states that count, second half; null: no truth")
    position_rmse_all: Number
    spearman_plain: Number = Field(description="rank correlation of errors with what the windows' samples alone predict")
    spearman_posterior: Number = Field(description="with the posterior information")
    spearman_own: Number = Field(description="with the filter's own covariance")
    calibration: CalibrationPart | None
    rejected: int = Field(description="samples that the gate kept out")
    hidden_windows: int = Field(description="windows whose samples do not see all of the state")
    title: str
    file: str
    about: list[str]
    unit: str = Field(description="of errors and predictions")
    samples: dict[str, int]
    rejected_by_sensor: dict[str, int]
    growth_by_sensor: dict[str, float] = Field(description="by what factor predicted errors grow without each sensor, mean of windows")
    locked_out: list[LockOutPart]
    ratio: Number = Field(description="median over the windows of error over prediction")
    spearman_intervals: dict[str, IntervalPart]
    windows: list[WindowPart]
    schedule: LogSchedulePart | None
    notes: list[str]


def document_of_log(study: LogStudy) -> ReplayDocument:
    """Return the document of a log."""
    drive = study.replay
    sensors = drive.run.sensors
    pairs = {"plain": drive.rank_correlation_plain, "posterior": drive.rank_correlation, "own": drive.rank_correlation_own}
    return ReplayDocument(
        position_rmse=drive.rmse_second_half,
        position_rmse_all=drive.rmse,
        spearman_plain=pairs["plain"].value,
        spearman_posterior=pairs["posterior"].value,
        spearman_own=pairs["own"].value,
        calibration=None if study.calibration is None else _calibration(study.calibration),
        rejected=drive.rejections,
        hidden_windows=len(drive.hidden_windows),
        title=study.setup.title,
        file=study.setup.file.name,
        about=list(drive.question.about),
        unit=drive.question.signal.unit,
        samples=_counts(sensors, drive.run.arrived.sum(axis=0)),
        rejected_by_sensor=_counts(sensors, drive.run.rejected.sum(axis=0)),
        growth_by_sensor=study.growth,
        locked_out=[LockOutPart(sensor=item.sensor, first=item.first, last=item.last) for item in drive.locked_out],
        ratio=drive.ratio,
        spearman_intervals={name: _interval(correlation) for name, correlation in pairs.items()},
        windows=[_window(sensors, window) for window in drive.windows],
        schedule=schedule_part(study),
        notes=list(study.notes),
    )


def _counts(names: tuple[str, ...], counts: np.ndarray) -> dict[str, int]:
    return dict(zip(names, counts.astype(int).tolist(), strict=True))


def _interval(correlation: RankCorrelation) -> IntervalPart:
    return IntervalPart(value=correlation.value, low=correlation.low, high=correlation.high, windows=correlation.windows)


def _window(sensors: tuple[str, ...], window: ReplayWindow) -> WindowPart:
    return WindowPart(
        first=window.first,
        last=window.last,
        samples=_counts(sensors, window.samples),
        error=window.error,
        predicted=window.predicted,
        own=window.own,
        plain=window.plain,
        hidden=window.hidden,
        growth=dict(zip(sensors, window.growth.tolist(), strict=True)),
    )


def _calibration(calibration: Calibration) -> CalibrationPart:
    names = calibration.system.model.state_names
    return CalibrationPart(
        numbers={
            entry.name: CalibratedPart(value=entry.value, low=entry.low, high=entry.high, unit=entry.unit, source=entry.source)
            for entry in calibration.numbers
        },
        disturbance_psd=dict(zip(names, calibration.disturbance_psd, strict=True)),
        input_psd=dict(calibration.input_psd),
        notes=list(calibration.notes),
    )


def schedule_part(study: LogStudy) -> LogSchedulePart | None:
    """Return the schedule of a log, None without one."""
    schedule = study.schedule
    if schedule is None:
        return None
    return LogSchedulePart(
        per_segment=study.setup.choice.per_segment,
        sensors=list(schedule.sensors),
        boundaries=schedule.boundaries.tolist(),
        chosen=schedule.chosen.astype(int).tolist(),
        value=schedule.value,
        bound=schedule.bound,
        gap=schedule.gap if math.isfinite(schedule.gap) else None,
        status=schedule.status.name,
        rmse={item.name: item.rmse for item in study.schedule_errors},
        notes=list(schedule.notes),
    )
