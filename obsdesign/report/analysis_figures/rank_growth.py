"""How the dimension grows with the derivatives that are taken."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from obsdesign.report.figures._drawing import BLUE, INK, OTHER_PATHS, Picture, inline_svg, legend_below, light_grid, styled_figure
from obsdesign.study.analysis_study import AnalysisStudy, case_name

_MOST = 8  # lines that can be told apart


def picture(study: AnalysisStudy) -> Picture | None:
    """Return a line for each case of all sensors together; None where no derivative adds anything."""
    cases = study.of_all_sensors[:_MOST]
    longest = max(len(analysis.verdict.ranks) for analysis in cases)
    if longest == 1:
        return None
    n = max(len(analysis.verdict.null_space) for analysis in cases)

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        light_grid(axes)
        if all(len(analysis.verdict.null_space) == n for analysis in cases):
            axes.axhline(n, color=INK, linestyle="--", linewidth=1.0, label="all states")
        for i, analysis in enumerate(cases):
            ranks = np.array([*analysis.verdict.ranks, *[analysis.verdict.ranks[-1]] * (longest - len(analysis.verdict.ranks))])
            colour = (BLUE, *OTHER_PATHS)[i % (1 + len(OTHER_PATHS))]
            # a little apart, so that none hides another
            axes.plot(np.arange(longest), ranks - 0.06 * i, "o-", markersize=4, color=colour, label=case_name(study, analysis))
        axes.set(xlabel="derivatives of the outputs", ylabel="dimensions seen", ylim=(0, n + 0.5))
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(integer=True))
        legend_below(figure, axes)

    caption = "Outputs alone tell little; each derivative of them adds what it can, until nothing is left to add."
    return Picture(inline_svg(styled_figure(3.2, paint), "growth", "Dimension over the order of derivatives"), caption)
