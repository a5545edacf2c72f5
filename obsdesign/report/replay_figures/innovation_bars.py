"""Whether innovations are as large as the filter expects, and whether they are new."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from obsdesign.report.figures._drawing import BLUE, FAINT, INK, OTHER_PATHS, Picture, inline_svg, light_grid, styled_figure
from obsdesign.study.log_study import LogStudy

_LAGS = 10
_MOST_LINES = 8


@dataclass(frozen=True, eq=False)
class SensorInnovations:
    """Of one sensor: mean normalised square over its number of outputs, and the correlation (L,) of innovations 1, 2, ... samples apart."""

    name: str
    count: int
    nis: float
    correlation: np.ndarray


def sensor_innovations(study: LogStudy) -> tuple[SensorInnovations, ...]:
    """Return the innovations of each sensor, those that the gate rejected left out."""
    return tuple(_innovations_of(study, s) for s in range(len(study.replay.run.sensors)))


def _innovations_of(study: LogStudy, s: int) -> SensorInnovations:
    run, model = study.replay.run, study.replay.question.system.model
    outputs = list(model.outputs_of[run.sensors[s]])
    taken = run.arrived[:, s] & ~run.rejected[:, s] & ~run.unusable[:, s]
    values = run.innovations[taken][:, outputs] / run.innovation_std[taken][:, outputs]
    nis = float(np.nanmean(run.nis[taken, s])) / len(outputs) if taken.any() else float("nan")
    lags = range(1, min(_LAGS, len(values) - 1) + 1)
    power = float(np.nanmean(values**2)) if taken.any() else 1.0
    correlation = np.array([float(np.nanmean(values[lag:] * values[:-lag])) / power for lag in lags])
    return SensorInnovations(run.sensors[s], int(taken.sum()), nis, correlation)


def picture(study: LogStudy) -> Picture:
    """Return normalised squares and autocorrelations of each sensor."""
    sensors = sensor_innovations(study)

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        left, right = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
        light_grid(left, "x")
        left.barh([item.name for item in sensors], [item.nis for item in sensors], color=BLUE, height=0.66)
        left.axvline(1.0, color=INK, linestyle=":", linewidth=1.2)
        left.set(xlabel="NIS per output", ylim=(len(sensors) - 0.4, -0.6))
        light_grid(right)
        right.axhspan(*_band(sensors), color=FAINT, alpha=0.7, linewidth=0)
        for i, item in enumerate(sensors[:_MOST_LINES]):
            colour = (BLUE, *OTHER_PATHS)[i % (1 + len(OTHER_PATHS))]
            right.plot(np.arange(1, len(item.correlation) + 1), item.correlation, color=colour, linewidth=1.1)
        right.set(xlabel="samples apart", ylabel="autocorrelation", ylim=(-0.6, 1.0))

    caption = (
        "Left: normalised innovations squared per output, 1 (dotted) where they are as large as the filter expects. Right: their"
        " autocorrelation, one line for each sensor, within the band for what is new each time; above it errors last, and are larger"
        " than the filter believes, whatever its NIS."
    )
    return Picture(inline_svg(styled_figure(1.6 + 0.24 * max(len(sensors), 5), paint), "nis", "Innovations of each sensor"), caption)


def _band(sensors: tuple[SensorInnovations, ...]) -> tuple[float, float]:
    count = max(min((item.count for item in sensors if item.count), default=1), 1)
    return -1.96 / count**0.5, 1.96 / count**0.5
