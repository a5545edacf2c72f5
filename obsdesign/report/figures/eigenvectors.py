"""What each eigenvector of the information matrix is made of: the combination of states known least, next least, ..."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.report.derived_quantities import clean_eigenvalues, sensors_in_words
from obsdesign.report.figures._drawing import INK, inline_svg
from obsdesign.scenario.schema import DESIGNED
from obsdesign.study.record import Study

_MIN_COMPONENT = 0.1  # a component smaller than this is left to its colour


@dataclass(frozen=True, eq=False)
class Panel:
    """Eigenvalues (n,), ascending, and eigenvectors (n, n), in columns, under a title."""

    title: str
    values: np.ndarray
    vectors: np.ndarray


def eigenvectors_figure(study: Study) -> str:
    """Draw the eigenvectors of S W S for the baseline and the designed path, one row per suite of sensors."""
    panels = [
        Panel(f"{name}, {sensors_in_words(study, quality.sensors)}", clean_eigenvalues(quality), quality.vectors)
        for suite in range(len(study.suites))
        for name in (study.baseline, DESIGNED)
        for quality in (study.candidate(name).qualities[suite],)
    ]
    return eigenvectors_picture(panels, study.scenario.state_names)


def eigenvectors_picture(panels: Sequence[Panel], states: Sequence[str]) -> str:
    """Draw panels two to a row: a row for each state, a column for each eigenvector."""
    rows = (len(panels) + 1) // 2

    def paint(figure: Figure) -> None:
        grid = figure.subplots(rows, 2, squeeze=False)
        for axes in grid.ravel()[len(panels) :]:
            axes.set_visible(False)
        for panel, axes in zip(panels, grid.ravel(), strict=False):
            _draw_panel(axes, panel, states)
        for axes in grid[:, 1]:
            axes.set_yticklabels([])
        figure.supxlabel("eigenvectors of S W S by their eigenvalues [–], known least first", fontsize=10)

    return inline_svg(
        "eigenvectors", "Components of the eigenvectors of the information matrix", 0.7 + (0.7 + 0.24 * len(states)) * rows, paint
    )


def _draw_panel(axes: Axes, panel: Panel, states: Sequence[str]) -> None:
    # the sign of an eigenvector means nothing: the largest component is shown as positive
    largest = np.take_along_axis(panel.vectors, np.abs(panel.vectors).argmax(axis=0)[None], axis=0)
    vectors = panel.vectors * np.sign(largest)
    axes.pcolormesh(vectors, cmap="PuOr_r", vmin=-1.3, vmax=1.3, edgecolors="white", linewidth=1)
    axes.invert_yaxis()
    for (i, j), component in np.ndenumerate(vectors):
        if abs(component) >= _MIN_COMPONENT:
            axes.text(
                j + 0.5, i + 0.5, f"{component:.1f}".replace("-", "\N{MINUS SIGN}"), ha="center", va="center", fontsize=7.5, color=INK
            )
    axes.set_yticks(np.arange(len(states)) + 0.5, states)
    axes.set_xticks(np.arange(len(panel.values)) + 0.5, [_power(value) for value in panel.values], fontsize=7.5)
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_title(panel.title, fontsize=9)


def _power(value: float) -> str:
    """One digit and a power of ten: the columns are narrow."""
    if value <= 0:
        return "0"
    digit, exponent = f"{value:.0e}".split("e")
    return rf"${digit}{{\cdot}}10^{{{int(exponent)}}}$" if not 0 <= int(exponent) <= 2 else f"{value:.0f}"
