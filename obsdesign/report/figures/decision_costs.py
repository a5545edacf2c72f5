"""What it costs to decide otherwise: sensor by sensor, segment by segment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from obsdesign.arguments import validate_arguments
from obsdesign.report.derived_quantities import drawing_suffix, segment_nodes
from obsdesign.report.figures._drawing import INK, QUIET, Picture, inline_svg, styled_figure
from obsdesign.report.figures.schedule_raster import sensor_labels
from obsdesign.report.names import path_in_words
from obsdesign.selection.schedule import Schedule
from obsdesign.study.record import Study

_LOWEST_COST, _HIGHEST_COST = 1e-2, 1e2  # % of the bound between which colours differ
_DOT: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 3.5, "color": "white", "markeredgecolor": INK}


@validate_arguments
def regret(schedule: Schedule, names: Sequence[str] | None = None, t: Sequence[float] | None = None) -> Figure:
    """Draw how much the bound falls for every decision that is taken otherwise, in the criterion's unit.

    Arguments:
        schedule: the schedule, of K segments and S sensors.
        names: what the S sensors are called; None = by number.
        t: where the segments begin and end (K+1,) [s]; None = segments are numbered.
    """
    return draw_regret(schedule, sensor_labels(schedule, names), t, absolute=True)


def picture(study: Study) -> Picture | None:
    """Return what deciding otherwise costs; None where there is no bound to compare with."""
    schedule = study.selection.schedule
    if not (np.isfinite(schedule.root_bound) and schedule.root_bound != 0):
        return None
    absolute = study.scenario.schedule_criterion.gap_kind == "absolute"
    figure = draw_regret(schedule, study.scenario.sensor_names, segment_nodes(study), absolute)
    description = f"What it costs to switch each sensor otherwise in each segment of {path_in_words(study.about)}"
    return Picture(inline_svg(figure, f"regret{drawing_suffix(study)}", description), _caption(schedule))


def deviation_costs(schedule: Schedule) -> np.ndarray:
    """Return (K, S): how much the bound falls when a sensor is forced off where it is on, on where it is off."""
    return np.where(schedule.chosen, schedule.forced_off, schedule.forced_on)


def count_proven_decisions(schedule: Schedule) -> tuple[int, int]:
    """How many of the decisions no better schedule takes otherwise, and how many there are."""
    cost = deviation_costs(schedule)
    return int((cost > schedule.root_bound - schedule.value).sum()), cost.size


def _caption(schedule: Schedule) -> str:
    """Say what the colours mean, and how many of the decisions are proven."""
    sure, total = count_proven_decisions(schedule)
    return (
        "What deciding otherwise costs: by how much the bound falls when a sensor that is off (a dot: on) is forced on (off) in that "
        f"segment. Dark costs much, white nothing. Where it costs more than what lies between the schedule and the bound, here "
        f"{sure} of {total} decisions, every schedule that is better decides the same."
    )


def draw_regret(schedule: Schedule, names: Sequence[str], t: Sequence[float] | np.ndarray | None, absolute: bool) -> Figure:
    """Draw what deciding otherwise costs, in the criterion's unit (absolute) or as a share of the bound."""
    cost = deviation_costs(schedule).T / (1.0 if absolute else abs(schedule.root_bound) / 100)
    times = np.arange(len(schedule.chosen) + 1.0) if t is None else np.asarray(t)

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        mesh = _draw_costs(axes, cost, times)
        _draw_dots(axes, schedule.chosen, times)
        axes.set_yticks(range(len(names)), names)
        axes.set(ylim=(len(names) - 0.5, -0.5), xlim=(times[0], times[-1]), xlabel="segment [–]" if t is None else "time [s]")
        axes.tick_params(axis="y", length=0)
        for side in axes.spines.values():
            side.set_visible(False)
        _draw_bar(figure, axes, mesh, "cost of deciding otherwise" + (" [–]" if absolute else " [% of the bound]"))
        figure.legend(handles=_keys(bool(np.isfinite(cost).all())), loc="outside lower center", ncols=2)

    return styled_figure(2.0 + 0.36 * len(names), paint)


def _draw_costs(axes: Axes, cost: np.ndarray, times: np.ndarray) -> QuadMesh:
    """Costs (S, K) by colour, grey where the rules forbid to decide otherwise."""
    possible = np.isfinite(cost)
    largest = float(cost[possible].max(initial=0.0))
    high = min(max(largest, 10 * _LOWEST_COST), _HIGHEST_COST)
    rows = np.arange(len(cost) + 1) - 0.5
    impossible = np.ma.masked_where(possible, np.ones_like(cost))
    axes.pcolormesh(times, rows, impossible, cmap=ListedColormap(["#e4e4e4"]), edgecolors="white", linewidth=0.8)
    shown = np.ma.masked_where(~possible, np.clip(np.where(possible, cost, 0.0), _LOWEST_COST, high))
    return axes.pcolormesh(times, rows, shown, cmap="Purples", norm=LogNorm(_LOWEST_COST, high), edgecolors="white", linewidth=0.8)


def _draw_dots(axes: Axes, chosen: np.ndarray, times: np.ndarray) -> None:
    middle = (times[:-1] + times[1:]) / 2
    for s, on in enumerate(chosen.T):
        axes.plot(middle[on], np.full(on.sum(), s), **_DOT)


def _draw_bar(figure: Figure, axes: Axes, mesh: QuadMesh, label: str) -> None:
    bar = figure.colorbar(mesh, ax=axes, orientation="horizontal", location="top", label=label, aspect=40, shrink=0.9, pad=0.02)
    bar.ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    if bar.solids is not None:
        bar.solids.set(rasterized=False, edgecolor="face")  # outlines, no picture inside the picture


def _keys(all_possible: bool) -> list[Artist]:
    handles: list[Artist] = [Line2D([], [], label="is on", **_DOT)]
    if not all_possible:
        handles.append(Patch(facecolor="#e4e4e4", edgecolor=QUIET, linewidth=0.4, label="impossible: the rules forbid it"))
    return handles
