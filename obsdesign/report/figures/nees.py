"""Whether the filter knows how well it does: run-averaged NEES and its band."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.arguments import validate_arguments
from obsdesign.estimation.validation import SETTLING_SHARE, Validation
from obsdesign.report.derived_quantities import drawing_suffix
from obsdesign.report.figures._cases import Case, cases_of, number_axis
from obsdesign.report.figures._drawing import BLUE, FAINT, INK, Picture, inline_svg, legend_below, light_grid, styled_figure
from obsdesign.report.number_format import NARROW, numeral
from obsdesign.study.record import Study


@validate_arguments
def consistency(validation: Validation) -> Figure:
    """Draw the run-averaged NEES over time, its 95 % band and where judging begins.

    Arguments:
        validation: filter runs, as validate returns them.
    """
    return draw_consistency([Case(validation, "filter", BLUE, True)])


def picture(study: Study) -> Picture:
    """Return the run-averaged NEES of every case over time."""
    figure = draw_consistency(cases_of(study))
    return Picture(
        inline_svg(figure, f"consistency{drawing_suffix(study)}", "Run-averaged NEES over time with its 95 % band"), _caption(study)
    )


def _caption(study: Study) -> str:
    """Say what the band is."""
    low, high = study.checks[0].validation.nees_interval
    n = len(study.scenario.state_names)
    return (
        f"A filter that knows how well it does stays in the grey band, {numeral(low)} to {numeral(high)} about {n}, at 95{NARROW}% of the "
        "instants; above it the filter is overconfident."
    )


def draw_consistency(cases: Sequence[Case]) -> Figure:
    """Draw the run-averaged NEES of every case over time, the 95 % band and where judging begins."""

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        _draw_nees(cases, axes)
        legend_below(figure, axes)

    return styled_figure(3.7, paint)


def _draw_nees(cases: Sequence[Case], axes: Axes) -> None:
    first = cases[0].validation
    light_grid(axes)
    for case in cases:
        look = {"linewidth": 1.6 if case.is_ours else 1.1, "zorder": 4 if case.is_ours else 3}
        axes.plot(case.validation.t, case.validation.nees, color=case.colour, label=case.label, **look)
    axes.axhspan(*first.nees_interval, color=FAINT, alpha=0.7, linewidth=0, label="95 % band", zorder=1)
    begin = first.t[0] + SETTLING_SHARE * (first.t[-1] - first.t[0])
    axes.axvline(begin, color=INK, linestyle=":", linewidth=1.2)
    every = np.concatenate([case.validation.nees for case in cases])
    low, high = min(every.min(), first.nees_interval[0]) / 1.15, max(every.max(), first.nees_interval[1]) * 1.3
    axes.set(yscale="log", ylim=(low, high), xlim=(first.t[0], first.t[-1]), xlabel="time [s]", ylabel="run-averaged NEES [–]")
    axes.annotate("judged from here", (begin, high), xytext=(4, -2), textcoords="offset points", va="top", fontsize=9)
    number_axis(axes, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0) if high / low < 12 else (1.0, 2.0, 5.0))
