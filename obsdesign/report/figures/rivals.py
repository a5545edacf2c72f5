"""The chosen schedule against what one would have done without thinking."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from obsdesign.report.figures._drawing import BLUE, FAINT, INK, QUIET, inline_svg, light_grid
from obsdesign.report.rounding import rounded
from obsdesign.study.record import CHOSEN, Study


def rivals_figure(study: Study) -> str:
    """Draw lambda_min of the chosen schedule, the naive ones and the random ones against the bound."""
    bars = rival_values(study)

    def paint(figure: Figure) -> None:
        _draw_bars(study, figure.add_subplot(), bars)

    return inline_svg("rivals", "Value of the chosen schedule, the naive ones and the bound", 0.95 + 0.36 * len(bars), paint)


def rival_values(study: Study) -> dict[str, float]:
    """Return lambda_min of each schedule, the chosen one first."""
    selection = study.selection
    random, count = selection.random_values, len(selection.random_values)
    naive = {rival.name: rival.value for rival in selection.rivals}
    tail = {f"best of {count} random": float(random[-1]), "median random": float(np.median(random))}
    return {CHOSEN: selection.schedule.value} | naive | tail


def _draw_bars(study: Study, axes: Axes, bars: dict[str, float]) -> None:
    bound = study.selection.schedule.bound
    light_grid(axes, "x")
    axes.barh(list(bars), list(bars.values()), height=0.66, color=[BLUE, *[QUIET] * (len(bars) - 1)])
    axes.axvline(bound, color=INK, linestyle=":", linewidth=1.2)
    widest = max(bound, *bars.values())
    for row, value in enumerate(bars.values()):
        inside = value > 0.3 * widest
        colour, side, shift = ("white", "right", -4) if inside else (INK, "left", 4)
        place = {"xytext": (shift, 0), "textcoords": "offset points", "ha": side, "va": "center"}
        axes.annotate(rounded(value), (value, row), color=colour, fontsize=9, **place)
    axes.set(xlim=(0, widest * 1.02), ylim=(len(bars) - 0.4, -0.6), xlabel=r"$\lambda_{min}$ of S W S [–]")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_color(FAINT)
    axes.set_title(f"no schedule lies beyond the dotted line, {rounded(bound)}", loc="right")
