"""What each eigenvector of the information matrix is made of: the combination of states known least, next least, ..."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from obsdesign.arguments import validate_arguments
from obsdesign.design.record import Design
from obsdesign.errors import InputError
from obsdesign.report.derived_quantities import clean_eigenvalues, sensors_in_words, without_zeros
from obsdesign.report.figures._drawing import INK, Picture, inline_svg, styled_figure
from obsdesign.report.names import path_in_words
from obsdesign.scenario.path_names import DESIGNED
from obsdesign.study.record import Study

_MIN_COMPONENT = 0.1  # a component smaller than this is left to its colour
_MIN_NAMED = 0.15  # components of a direction smaller than this go without saying


@dataclass(frozen=True, eq=False)
class EigenvectorPanel:
    """Eigenvalues (n,), ascending, and eigenvectors (n, n), in columns, under a title."""

    title: str
    values: np.ndarray
    vectors: np.ndarray


@validate_arguments
def eigenvectors(design: Design) -> Figure:
    """Draw the eigenvectors of S W S of a designed path, all its sensors on: what each is made of.

    Arguments:
        design: the design, with a path.
    Raises InputError for a design without a path.
    """
    if design.information is None:
        raise InputError(f"design: has no path to draw: {design.status.value}")
    values, vectors = np.linalg.eigh(design.problem.scaled(design.information.total))
    return draw_panels([EigenvectorPanel("designed, all sensors", without_zeros(values), vectors)], design.problem.system.model.state_names)


def picture(study: Study) -> Picture:
    """Return the eigenvectors of S W S for the baseline and the designed path, one row per suite of sensors."""
    panels = [
        EigenvectorPanel(f"{name}, {sensors_in_words(study, quality.sensors)}", clean_eigenvalues(quality), quality.vectors)
        for suite in range(len(study.suites))
        for name in (study.baseline, DESIGNED)
        for quality in (study.candidate(name).qualities[suite],)
    ]
    figure = draw_panels(panels, study.scenario.state_names)
    return Picture(inline_svg(figure, "eigenvectors", "Components of the eigenvectors of the information matrix"), _caption(study))


def _caption(study: Study) -> str:
    """Say how the panels are read, and what the first column of the baseline hides."""
    quality = study.candidate(study.baseline).qualities[-1]
    parts = [study.scenario.state_names[i] for i in np.argsort(-np.abs(quality.weakest)) if abs(quality.weakest[i]) >= _MIN_NAMED]
    suite = sensors_in_words(study, quality.sensors)
    visibility = "hidden from" if clean_eigenvalues(quality)[0] == 0 else "known least to"
    mixture = f"{parts[0]} alone" if len(parts) == 1 else f"{parts[0]} against {' and '.join(parts[1:])}"
    return (
        "Each column is a combination of scaled states, its squares adding up to 1, that is known as well as the number below it says. "
        f"On {path_in_words(study.baseline)}, {mixture} is what is {visibility} {suite}."
    )


def draw_panels(panels: Sequence[EigenvectorPanel], states: Sequence[str]) -> Figure:
    """Draw panels two to a row: a row for each state, a column for each eigenvector."""
    rows = (len(panels) + 1) // 2

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        grid = figure.subplots(rows, 2, squeeze=False)
        for axes in grid.ravel()[len(panels) :]:
            axes.set_visible(False)
        for panel, axes in zip(panels, grid.ravel(), strict=False):
            _draw_panel(axes, panel, states)
        for axes in grid[:, 1]:
            axes.set_yticklabels([])
        figure.supxlabel("eigenvectors of S W S by their eigenvalues [–], known least first", fontsize=10)

    return styled_figure(0.7 + (0.7 + 0.24 * len(states)) * rows, paint)


def _draw_panel(axes: Axes, panel: EigenvectorPanel, states: Sequence[str]) -> None:
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
