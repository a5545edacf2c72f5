"""Which sensor is on when, in as few strokes as a long log needs."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from obsdesign.report.figures._drawing import BLUE, Picture, inline_svg, styled_figure
from obsdesign.selection.posterior.filter_schedule import FilterSchedule


def picture(schedule: FilterSchedule, first: float) -> Picture:
    """Return sensors by segments, blue where on; first: when the log begins [s]."""
    edges, sensors = schedule.boundaries - first, len(schedule.sensors)

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        colours = ListedColormap(["#f2f2f2", BLUE])
        axes.pcolormesh(edges, np.arange(sensors + 1), schedule.chosen.T.astype(float), cmap=colours, vmin=0, vmax=1)
        axes.set_yticks(np.arange(sensors) + 0.5, schedule.sensors)
        axes.hlines(np.arange(1, sensors), edges[0], edges[-1], color="white", linewidth=3)
        axes.set(ylim=(sensors, 0), xlim=(edges[0], edges[-1]), xlabel="time since the beginning [s]")
        axes.tick_params(axis="y", length=0)

    caption = "Blue is on. The schedule is chosen with the samples that arrived: what did not is not counted on."
    return Picture(inline_svg(styled_figure(0.9 + 0.3 * max(sensors, 3), paint), "chosen", "Which sensor is on when"), caption)
