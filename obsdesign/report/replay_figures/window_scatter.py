"""What was predicted of each window against what happened."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from obsdesign.report.figures._drawing import BLUE, INK, VERMILLION, Picture, inline_svg, legend_below, light_grid, styled_figure
from obsdesign.report.number_format import numeral
from obsdesign.study.log_study import LogStudy


def picture(study: LogStudy) -> Picture | None:
    """Return the windows, None where no truth says what happened."""
    drive = study.replay
    pairs = np.array([(window.predicted, window.error) for window in drive.windows])
    pairs = pairs[np.isfinite(pairs).all(axis=1) & (pairs > 0).all(axis=1)]
    if not len(pairs):
        return None

    unit = f" [{drive.question.signal.unit or '–'}]"

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        light_grid(axes)
        axes.plot(*pairs.T, linestyle="none", marker="o", markersize=4, color=BLUE, alpha=0.6, label="a window", zorder=3)
        low, high = pairs.min() / 1.2, pairs.max() * 1.2
        line = np.array([low, high])
        axes.plot(line, line, color=INK, linewidth=1.0, label="as predicted")
        axes.plot(line, drive.ratio * line, color=VERMILLION, linestyle="--", linewidth=1.2, label=f"times {numeral(drive.ratio)}")
        axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high), xlabel=f"predicted{unit}", ylabel=f"actual{unit}")
        legend_below(figure, axes, 3)

    caption = (
        "Root mean square error of each window against what was predicted of it. That they rank alike needs no truth to make use of;"
        f" the factor between them, {numeral(drive.ratio)}, does."
    )
    return Picture(inline_svg(styled_figure(4.2, paint), "windows", "Predicted and actual errors of windows"), caption)
