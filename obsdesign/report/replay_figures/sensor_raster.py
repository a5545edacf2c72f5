"""Which sensor mattered when."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from obsdesign.report.figures._drawing import Picture, inline_svg, styled_figure
from obsdesign.study.log_study import LogStudy

_MOST = 4.0  # factor beyond which colours do not tell more


def picture(study: LogStudy) -> Picture:
    """Return sensors by windows, coloured by what the predicted error grows by without the sensor."""
    drive = study.replay
    growth = np.array([window.growth for window in drive.windows]).T
    arrived = np.array([window.samples > 0 for window in drive.windows]).T
    edges = np.array([drive.windows[0].first, *(window.last for window in drive.windows)]) - drive.t[0]

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        values = np.where(arrived, np.clip(growth, 1.0, _MOST), np.nan)
        mesh = axes.pcolormesh(edges, np.arange(len(growth) + 1), values, cmap="cividis", norm=LogNorm(1.0, _MOST), rasterized=False)
        axes.set_facecolor("#ffffff")
        axes.set_yticks(np.arange(len(growth)) + 0.5, drive.run.sensors)
        axes.set(ylim=(len(growth), 0), xlabel="time since the beginning [s]")
        bar = figure.colorbar(mesh, ax=axes, orientation="vertical", shrink=0.9)
        bar.set_ticks([1.0, 1.2, 1.5, 2.0, 3.0, 4.0], labels=["1", "1.2", "1.5", "2", "3", "4 or more"])
        bar.minorticks_off()

    caption = (
        "By what factor the predicted error of a window grows without the samples of a sensor: 1 (dark) is one that could have been off;"
        " white: no sample arrived. The log says which samples there were, not which were needed: this does, before any truth is known."
    )
    return Picture(inline_svg(styled_figure(1.1 + 0.3 * max(len(growth), 3), paint), "matters", "Sensors by windows"), caption)
