"""Two numbers that compete: what is better in one is worse in the other."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from obsdesign.report.figures._drawing import BLUE, QUIET, Picture, inline_svg, legend_below, light_grid, styled_figure
from obsdesign.report.sweep_figures.small_multiples import Panel


def picture(name: str, first: Panel, second: Panel, is_best: np.ndarray) -> Picture:
    """Return the runs in the plane of two numbers; is_best (runs,): no other run is as good in both and better in one."""

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        light_grid(axes)
        axes.plot(first.values[~is_best], second.values[~is_best], "o", markersize=4, color=QUIET, alpha=0.7, label="a run")
        order = np.flatnonzero(is_best)[np.argsort(first.values[is_best])]
        axes.plot(
            first.values[order], second.values[order], "o-", markersize=5, color=BLUE, linewidth=1, label="none is better in both", zorder=3
        )
        axes.set(xlabel=first.label, ylabel=second.label)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(5))
        legend_below(figure, axes)

    caption = f"{first.label} against {second.label}: the {int(is_best.sum())} runs on the line are those among which one has to choose."
    return Picture(inline_svg(styled_figure(3.8, paint), name, f"{first.label} against {second.label}"), caption)
