"""The eigenvalues of the information matrix, path by path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from obsdesign.arguments import validate_arguments
from obsdesign.design.record import Design
from obsdesign.errors import InputError
from obsdesign.report.derived_quantities import cap_for, clean_eigenvalues, judged_by_eigenvalue, sensors_in_words, without_zeros
from obsdesign.report.figures._drawing import BLUE, INK, Picture, inline_svg, light_grid, path_colour, styled_figure
from obsdesign.report.number_format import numeral
from obsdesign.study.record import Study

_LETTERS = 56  # that fit side by side below the columns


@dataclass(frozen=True, eq=False)
class SpectrumPanel:
    """Eigenvalues (n,) of each path, ascending, 0 where they cannot be told from it, and the cap on the smallest one."""

    title: str
    eigenvalues: Mapping[str, np.ndarray]
    cap: float | None = None


@validate_arguments
def spectrum(design: Design) -> Figure:
    """Draw the eigenvalues of S W S of a designed path, all its sensors on.

    Arguments:
        design: the design, with a path.
    Raises InputError for a design without a path.
    """
    if design.information is None:
        raise InputError(f"design: has no path to draw: {design.status.value}")
    eigenvalues = without_zeros(np.linalg.eigvalsh(design.problem.scaled(design.information.total)))
    cap = None if design.cap is None else design.cap.value
    return draw_spectra([SpectrumPanel("all sensors", {"designed": eigenvalues}, cap)], {"designed": BLUE})


def picture(study: Study) -> Picture:
    """Return the eigenvalues of S W S for each path, one panel per suite of sensors."""
    names = tuple(candidate.name for candidate in study.candidates)
    figure = draw_spectra(_panels(study), {name: path_colour(name, names) for name in names})
    description = "Eigenvalues of the information matrix for each path and suite of sensors"
    return Picture(inline_svg(figure, "spectrum", description), _caption(study))


def _panels(study: Study) -> list[SpectrumPanel]:
    panels = []
    for suite, sensors in enumerate(study.suites):
        eigenvalues = {candidate.name: clean_eigenvalues(candidate.qualities[suite]) for candidate in study.candidates}
        cap = cap_for(study, sensors) if judged_by_eigenvalue(study) else None
        panels.append(SpectrumPanel(sensors_in_words(study, sensors), eigenvalues, None if cap is None else cap.value))
    return panels


def _caption(study: Study) -> str:
    """Say what the eigenvalues mean and how those that are 0 are drawn."""
    zero = any(clean_eigenvalues(quality)[0] == 0 for candidate in study.candidates for quality in candidate.qualities)
    tail = " A hollow dot is 0 to double precision, drawn at the floor: a combination of states that stays hidden." if zero else ""
    return f"The large dot of each path is what is known of the combination of states that is known least: higher is better.{tail}"


def draw_spectra(panels: Sequence[SpectrumPanel], colours: Mapping[str, str]) -> Figure:
    """Draw panels one below the other, a column for each path in its colour, eigenvalues that are 0 hollow at the floor."""
    everything = np.concatenate([values for panel in panels for values in panel.eigenvalues.values()])
    lowest = everything[everything > 0].min()
    floor = float(10.0 ** (np.floor(np.log10(lowest)) - 1) if (everything == 0).any() else lowest)

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        for panel, axes in zip(panels, np.atleast_1d(figure.subplots(len(panels), 1, sharex=True, sharey=True)), strict=True):
            _draw_panel(axes, panel, colours, floor)
            axes.set(yscale="log", xlim=(-0.6, len(colours) - 0.15), ylim=(floor / 30, everything.max() * 5))
            axes.yaxis.set_minor_locator(NullLocator())
            axes.set_xticks(range(len(colours)), [fill(name, _LETTERS // len(colours), break_long_words=False) for name in colours])
            axes.set_title(panel.title, fontweight="bold")
        figure.supylabel("eigenvalues of S W S [–]", fontsize=10)

    return styled_figure(0.7 + 2.1 * len(panels), paint)


def _draw_panel(axes: Axes, panel: SpectrumPanel, colours: Mapping[str, str], floor: float) -> None:
    light_grid(axes, "y")
    for column, (name, values) in enumerate(panel.eigenvalues.items()):
        _draw_spectrum(axes, column, values, floor, colours[name])
    if panel.cap is not None:
        axes.axhline(panel.cap, color=INK, linewidth=1, linestyle=":", zorder=1)
        axes.text(len(colours) - 0.45, panel.cap, f"cap\n{numeral(panel.cap)}", va="center", ha="left", fontsize=9)


def _draw_spectrum(axes: Axes, column: int, values: np.ndarray, floor: float, colour: str) -> None:
    """One column: the range, each eigenvalue, the smallest one large and with its number."""
    shown = np.maximum(values, floor)
    axes.plot([column, column], [shown[0], shown[-1]], color=colour, linewidth=1, alpha=0.6)
    axes.plot(np.full(len(shown) - 1, column), shown[1:], linestyle="none", marker="o", markersize=5, color=colour)
    inside = "white" if values[0] == 0 else colour
    marker = {"marker": "o", "markersize": 8, "color": colour, "markerfacecolor": inside, "markeredgewidth": 1.5}
    axes.plot(column, shown[0], linestyle="none", **marker)
    axes.annotate(numeral(values[0]), (column, shown[0]), xytext=(0, -7), textcoords="offset points", ha="center", va="top", fontsize=9)
