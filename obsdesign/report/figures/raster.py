"""The schedule: which sensor is on when."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.report.derived_quantities import drawing_suffix, segment_nodes
from obsdesign.report.figures._drawing import BLUE, inline_svg
from obsdesign.report.names import gap_in_words, path_in_words
from obsdesign.report.number_format import numeral
from obsdesign.study.record import Study


def raster_figure(study: Study) -> str:
    """Draw the chosen schedule: one row per sensor, one column per segment, filled where the sensor is on."""
    sensors = len(study.scenario.sensors)

    def paint(figure: Figure) -> None:
        _draw_raster(study, figure.add_subplot())

    return inline_svg(
        f"raster{drawing_suffix(study)}",
        f"Which sensor is on in which segment of {path_in_words(study.about)}",
        1.15 + 0.36 * sensors,
        paint,
    )


def _draw_raster(study: Study, axes: Axes) -> None:
    schedule, names, times = study.selection.schedule, study.scenario.sensor_names, segment_nodes(study)
    starts, lengths = times[:-1], np.diff(times)
    for row in range(len(names)):
        on = schedule.chosen[:, row]
        axes.barh(np.full(len(starts), row), lengths, left=starts, height=0.72, color="#f2f2f2", edgecolor="white", linewidth=0.8)
        axes.barh(np.full(on.sum(), row), lengths[on], left=starts[on], height=0.72, color=BLUE, edgecolor="white", linewidth=0.8)
    axes.set_yticks(range(len(names)), names)
    axes.set(ylim=(len(names) - 0.4, -0.6), xlim=(times[0], times[-1]), xlabel="time [s]")
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    name = study.scenario.schedule_criterion.symbol
    axes.set_title(f"{name} {numeral(schedule.value)}, bound {numeral(schedule.bound)}, gap {gap_in_words(study)}")
