"""The eigenvalues of the information matrix, path by path."""

from __future__ import annotations

from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from obsdesign.report.derived_quantities import cap_for, clean_eigenvalues, judged_by_eigenvalue, sensors_in_words
from obsdesign.report.figures._drawing import INK, inline_svg, light_grid, path_colour
from obsdesign.report.number_format import numeral
from obsdesign.study.record import Study

_LETTERS = 56  # that fit side by side below the columns


def spectrum_figure(study: Study) -> str:
    """Draw the eigenvalues of S W S for each path, one panel per suite of sensors, those that are 0 hollow at the floor."""
    count = len(study.suites)

    def paint(figure: Figure) -> None:
        panels = np.atleast_1d(figure.subplots(count, 1, sharex=True, sharey=True))
        for i, axes in enumerate(panels):
            _draw_suite(study, axes, i)
        figure.supylabel("eigenvalues of S W S [–]", fontsize=10)

    return inline_svg("spectrum", "Eigenvalues of the information matrix for each path and suite of sensors", 0.7 + 2.1 * count, paint)


def _draw_suite(study: Study, axes: Axes, suite: int) -> None:
    names = tuple(candidate.name for candidate in study.candidates)
    everything = np.concatenate([clean_eigenvalues(quality) for candidate in study.candidates for quality in candidate.qualities])
    lowest = everything[everything > 0].min()
    floor = 10.0 ** (np.floor(np.log10(lowest)) - 1) if (everything == 0).any() else lowest
    light_grid(axes, "y")
    for column, candidate in enumerate(study.candidates):
        _draw_spectrum(axes, column, clean_eigenvalues(candidate.qualities[suite]), floor, path_colour(candidate.name, names))
    cap = cap_for(study, study.suites[suite])
    if cap is not None and judged_by_eigenvalue(study):
        axes.axhline(cap.value, color=INK, linewidth=1, linestyle=":", zorder=1)
        axes.text(len(names) - 0.45, cap.value, f"cap\n{numeral(cap.value)}", va="center", ha="left", fontsize=9)
    axes.set(yscale="log", xlim=(-0.6, len(names) - 0.15), ylim=(floor / 30, everything.max() * 5))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_xticks(range(len(names)), [fill(name, _LETTERS // len(names), break_long_words=False) for name in names])
    axes.set_title(sensors_in_words(study, study.suites[suite]), fontweight="bold")


def _draw_spectrum(axes: Axes, column: int, values: np.ndarray, floor: float, colour: str) -> None:
    """One column: the range, each eigenvalue, the smallest one large and with its number."""
    shown = np.maximum(values, floor)
    axes.plot([column, column], [shown[0], shown[-1]], color=colour, linewidth=1, alpha=0.6)
    axes.plot(np.full(len(shown) - 1, column), shown[1:], linestyle="none", marker="o", markersize=5, color=colour)
    inside = "white" if values[0] == 0 else colour
    marker = {"marker": "o", "markersize": 8, "color": colour, "markerfacecolor": inside, "markeredgewidth": 1.5}
    axes.plot(column, shown[0], linestyle="none", **marker)
    axes.annotate(numeral(values[0]), (column, shown[0]), xytext=(0, -7), textcoords="offset points", ha="center", va="top", fontsize=9)
