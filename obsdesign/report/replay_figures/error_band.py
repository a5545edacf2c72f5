"""The error of the estimate over time against two standard deviations."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.report.figures._drawing import (
    BLUE,
    FAINT,
    INK,
    ORANGE,
    VERMILLION,
    Picture,
    inline_svg,
    legend_below,
    light_grid,
    styled_figure,
)
from obsdesign.study.log_study import LogStudy

_MOST_POINTS = 1500


def picture(study: LogStudy) -> Picture:
    """Return the error of what counts with 2 sigma of filter and bound, rejected samples, and windows with hidden states."""

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        _draw_sizes(axes, study)
        _draw_marks(axes, study)
        legend_below(figure, axes)

    has_truth = np.isfinite(study.replay.rmse)
    expected = "The error should stay below the filter's 2σ most of the time" if has_truth else "There is no truth: what the filter expects"
    caption = (
        f"{expected}; the dotted line is 2σ of the bound, which no filter is below."
        " Shaded: windows whose samples do not see all of the state."
        " Ticks at the top: samples that the gate rejected."
    )
    return Picture(inline_svg(styled_figure(3.7, paint), "band", "Error and two standard deviations over time"), caption)


def _draw_sizes(axes: Axes, study: LogStudy) -> None:
    drive = study.replay
    places, t = drive.question.places, drive.t - drive.t[0]
    every = max(len(t) // _MOST_POINTS, 1)
    own, bound = 2 * drive.question.size_of(drive.covariance), 2 * np.sqrt((drive.bound[:, places] ** 2).sum(axis=1))
    error = np.sqrt((drive.error[:, places] ** 2).sum(axis=1))
    light_grid(axes)
    if np.isfinite(error).any():
        axes.plot(t[::every], error[::every], color=BLUE, linewidth=0.9, label="error", zorder=3)
    axes.plot(t[::every], own[::every], color=INK, linewidth=1.1, label="filter, 2σ", zorder=4)
    axes.plot(t[::every], bound[::every], color=ORANGE, linewidth=1.1, linestyle=":", label="bound, 2σ", zorder=4)
    shown = np.concatenate([error[np.isfinite(error) & (error > 0)], own, bound])
    low, high = np.quantile(shown, [0.005, 1.0])
    axes.set(yscale="log", ylim=(low, 1.6 * high), xlim=(0, t[-1]), xlabel="time since the beginning [s]")
    axes.set_ylabel(_label(study))


def _label(study: LogStudy) -> str:
    """What counts, with its unit."""
    question = study.replay.question
    unit = question.system.model.states[question.places[0]].unit
    return f"error of {', '.join(question.about)} [{unit}]"


def _draw_marks(axes: Axes, study: LogStudy) -> None:
    drive = study.replay
    for i, window in enumerate(drive.hidden_windows):
        label = "not all seen" if i == 0 else "_"
        axes.axvspan(window.first - drive.t[0], window.last - drive.t[0], color=FAINT, alpha=0.8, linewidth=0, label=label, zorder=1)
    times = drive.t[:-1][drive.run.rejected.any(axis=1)] - drive.t[0]
    if len(times):
        top = np.full(len(times), axes.get_ylim()[1])
        axes.plot(times, top, linestyle="none", marker="|", markersize=9, color=VERMILLION, label="rejected", clip_on=False, zorder=5)
