"""What it costs to decide otherwise: sensor by sensor, segment by segment."""

from __future__ import annotations

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from obsdesign.report.derived_quantities import drawing_suffix, segment_nodes
from obsdesign.report.figures._drawing import INK, QUIET, inline_svg
from obsdesign.report.names import path_in_words
from obsdesign.report.sections.schedule import deviation_costs
from obsdesign.study.record import Study

_LOWEST_COST, _HIGHEST_COST = 1e-2, 1e2  # % of the bound between which colours differ


def regret_figure(study: Study) -> str:
    """Draw how much the bound falls for every decision that is taken otherwise; "" where there is no bound to compare with."""
    sensors, bound = len(study.scenario.sensors), study.selection.schedule.root_bound
    if not (np.isfinite(bound) and bound != 0):
        return ""

    def paint(figure: Figure) -> None:
        _draw(study, figure, figure.add_subplot())

    description = f"What it costs to switch each sensor otherwise in each segment of {path_in_words(study.about)}"
    return inline_svg(f"regret{drawing_suffix(study)}", description, 2.0 + 0.36 * sensors, paint)


def _draw(study: Study, figure: Figure, axes: Axes) -> None:
    schedule, names, times = study.selection.schedule, study.scenario.sensor_names, segment_nodes(study)
    absolute = study.scenario.schedule_criterion.gap_kind == "absolute"
    cost = deviation_costs(study).T / (1.0 if absolute else abs(schedule.root_bound) / 100)
    possible = np.isfinite(cost)
    largest = float(cost[possible].max(initial=0.0))
    high = min(max(largest, 10 * _LOWEST_COST), _HIGHEST_COST)
    rows = np.arange(len(names) + 1) - 0.5
    impossible = np.ma.masked_where(possible, np.ones_like(cost))
    axes.pcolormesh(times, rows, impossible, cmap=ListedColormap(["#e4e4e4"]), edgecolors="white", linewidth=0.8)
    shown = np.ma.masked_where(~possible, np.clip(np.where(possible, cost, 0.0), _LOWEST_COST, high))
    mesh = axes.pcolormesh(times, rows, shown, cmap="Purples", norm=LogNorm(_LOWEST_COST, high), edgecolors="white", linewidth=0.8)
    dot = {"linestyle": "none", "marker": "o", "markersize": 3.5, "color": "white", "markeredgecolor": INK}
    middle = (times[:-1] + times[1:]) / 2
    for s in range(len(names)):
        on = schedule.chosen[:, s]
        axes.plot(middle[on], np.full(on.sum(), s), **dot)
    axes.set_yticks(range(len(names)), names)
    axes.set(ylim=(len(names) - 0.5, -0.5), xlim=(times[0], times[-1]), xlabel="time [s]")
    axes.tick_params(axis="y", length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    label = "cost of deciding otherwise" + (" [–]" if absolute else " [% of the bound]")
    bar = figure.colorbar(mesh, ax=axes, orientation="horizontal", location="top", label=label, aspect=40, shrink=0.9, pad=0.02)
    bar.ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    if bar.solids is not None:
        bar.solids.set(rasterized=False, edgecolor="face")  # outlines, no picture inside the picture
    handles: list[Artist] = [Line2D([], [], label="is on", **dot)]
    if not possible.all():
        handles.append(Patch(facecolor="#e4e4e4", edgecolor=QUIET, linewidth=0.4, label="impossible: the rules forbid it"))
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
