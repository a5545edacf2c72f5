"""The schedule: which sensor is on when."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.arguments import validate_arguments
from obsdesign.report.derived_quantities import drawing_suffix, segment_nodes
from obsdesign.report.figures._drawing import BLUE, Picture, inline_svg, styled_figure
from obsdesign.report.names import filter_gap, gap_in_words, path_in_words
from obsdesign.report.number_format import NARROW, numeral, plain
from obsdesign.scenario.selection_tables import Question
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.schedule import Schedule
from obsdesign.study.rated_schedules import FOR
from obsdesign.study.record import Study


@validate_arguments
def schedule(schedule: Schedule | FilterSchedule, names: Sequence[str] | None = None, t: Sequence[float] | None = None) -> Figure:
    """Draw a schedule: one row per sensor, one column per segment, filled where the sensor is on.

    Arguments:
        schedule: the schedule, of K segments and S sensors, for the start or for a filter.
        names: what the S sensors are called; None = as the schedule knows them, or by number.
        t: where the segments begin and end (K+1,) [s]; None = as the schedule knows them, or segments are numbered.
    """
    title = f"value {numeral(schedule.value)}, bound {numeral(schedule.bound)}, gap {numeral(schedule.gap)}"
    if isinstance(schedule, FilterSchedule):
        names, t = names or schedule.sensors, schedule.boundaries.tolist() if t is None else t
        return draw_rasters([(title, schedule.chosen)], names, t)
    return draw_rasters([(title, schedule.chosen)], sensor_labels(schedule, names), t)


def picture(study: Study) -> Picture:
    """Return the raster of the schedules of all questions, that of the one that is asked above."""
    rasters = _rasters(study)
    figure = draw_rasters(rasters, study.scenario.sensor_names, segment_nodes(study))
    description = f"Which sensor is on in which segment of {path_in_words(study.about)}"
    seconds = plain(study.scenario.time.segment)
    caption = f"Blue is on, for {seconds}{NARROW}s each; a sensor without blue is not needed on this path when the others may be used."
    return Picture(inline_svg(figure, f"raster{drawing_suffix(study)}", description), caption)


def sensor_labels(schedule: Schedule, names: Sequence[str] | None) -> Sequence[str]:
    """Return names, or what sensors are called where nobody names them."""
    return [f"sensor {s}" for s in range(schedule.chosen.shape[1])] if names is None else names


def draw_rasters(rasters: Sequence[tuple[str, np.ndarray]], names: Sequence[str], t: Sequence[float] | np.ndarray | None) -> Figure:
    """Draw schedules (K, S) below each other, each under its title; segments are numbered where their times t (K+1,) are None."""
    times = np.arange(len(rasters[0][1]) + 1.0) if t is None else np.asarray(t)

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        panels = figure.subplots(len(rasters), 1, sharex=True, squeeze=False).ravel()
        for axes, (title, chosen) in zip(panels, rasters, strict=True):
            _draw_rows(axes, chosen, times)
            axes.set_yticks(range(len(names)), names)
            axes.set(ylim=(len(names) - 0.4, -0.6), xlim=(times[0], times[-1]))
            axes.tick_params(axis="y", length=0)
            axes.spines["left"].set_visible(False)
            axes.set_title(title)
        panels[-1].set_xlabel("segment [–]" if t is None else "time [s]")

    return styled_figure(0.5 + len(rasters) * (0.65 + 0.36 * len(names)), paint)


def _rasters(study: Study) -> list[tuple[str, np.ndarray]]:
    """Titles and schedules (K, S) for each question that has an answer, that of the one that is asked first."""
    selection, start = study.selection, study.selection.schedule
    values = f"{study.scenario.schedule_criterion.symbol} {numeral(start.value)}, gap {gap_in_words(study)}"
    titles: dict[Question, str] = {"start": values}
    if selection.filter is not None and selection.filter.schedule.status.has_answer:
        titles["filter"] = f"cost {numeral(selection.filter.schedule.value)}, gap {filter_gap(study, selection.filter)}"
    if selection.cheapest is not None and selection.cheapest.schedule.status.has_answer:
        cheapest = selection.cheapest.schedule
        titles["cheapest"] = f"costs {numeral(cheapest.value)}, none that keeps what is required less than {numeral(cheapest.bound)}"
    if len(titles) == 1:
        return [(values, start.chosen)]
    ordered = sorted(titles, key=lambda question: question != selection.question_in_use)
    return [(f"{FOR[question]}: {titles[question]}", selection.answers.get(question, start.chosen)) for question in ordered]


def _draw_rows(axes: Axes, chosen: np.ndarray, times: np.ndarray) -> None:
    starts, lengths = times[:-1], np.diff(times)
    for row, on in enumerate(chosen.T):
        axes.barh(np.full(len(starts), row), lengths, left=starts, height=0.72, color="#f2f2f2", edgecolor="white", linewidth=0.8)
        axes.barh(np.full(on.sum(), row), lengths[on], left=starts[on], height=0.72, color=BLUE, edgecolor="white", linewidth=0.8)
