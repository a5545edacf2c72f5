"""Whether the filter knows how well it does: run-averaged NEES and its band."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.report.derived_quantities import drawing_suffix, settling_time
from obsdesign.report.figures._drawing import FAINT, INK, inline_svg, legend_below, light_grid
from obsdesign.report.figures.errors import case_colour, is_ours, number_axis
from obsdesign.study.record import Study


def consistency_figure(study: Study) -> str:
    """Draw the run-averaged NEES of every case over time, its 95 % band and where judging begins."""

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot()
        _draw_nees(study, axes)
        legend_below(figure, axes)

    return inline_svg(f"consistency{drawing_suffix(study)}", "Run-averaged NEES over time with its 95 % band", 3.7, paint)


def _draw_nees(study: Study, axes: Axes) -> None:
    first = study.checks[0].validation
    light_grid(axes)
    for check in study.checks:
        ours = is_ours(study, check)
        look = {"linewidth": 1.6 if ours else 1.1, "zorder": 4 if ours else 3}
        axes.plot(
            check.validation.t, check.validation.nees, color=case_colour(study, check), label=f"{check.path}, {check.schedule}", **look
        )
    axes.axhspan(*first.nees_interval, color=FAINT, alpha=0.7, linewidth=0, label="95 % band", zorder=1)
    begin = first.t[0] + settling_time(study)
    axes.axvline(begin, color=INK, linestyle=":", linewidth=1.2)
    every = np.concatenate([check.validation.nees for check in study.checks])
    low, high = min(every.min(), first.nees_interval[0]) / 1.15, max(every.max(), first.nees_interval[1]) * 1.3
    axes.set(yscale="log", ylim=(low, high), xlim=(first.t[0], first.t[-1]), xlabel="time [s]", ylabel="run-averaged NEES [–]")
    axes.annotate("judged from here", (begin, high), xytext=(4, -2), textcoords="offset points", va="top", fontsize=9)
    number_axis(axes, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0) if high / low < 12 else (1.0, 2.0, 5.0))
