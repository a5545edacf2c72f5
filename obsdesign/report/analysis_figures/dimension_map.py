"""What is seen by whom in which case, as a map."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from obsdesign.report.figures._drawing import FAINT, GREEN, INK, ORANGE, Picture, inline_svg, styled_figure
from obsdesign.study.record import Analysis

_ROW, _MOST_ROWS = 0.27, 40  # inches; suites beyond that many are in the table alone


def picture(cases: Sequence[Analysis]) -> Picture | None:
    """Return a square for each suite and case, full where every state is seen; None for one verdict alone."""
    suites, names = (
        list(dict.fromkeys(column)) for column in zip(*((analysis.sensors, analysis.manoeuvre) for analysis in cases), strict=True)
    )
    if len(cases) == 1 or len(suites) > _MOST_ROWS:
        return None
    n = len(cases[0].verdict.null_space)

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        for analysis in cases:
            column, row = names.index(analysis.manoeuvre), suites.index(analysis.sensors)
            share = analysis.verdict.dimension / len(analysis.verdict.null_space)
            axes.add_patch(Rectangle((column - 0.48, row - 0.46), 0.96, 0.92, facecolor=FAINT, alpha=0.4))
            colour = GREEN if analysis.verdict.observable else ORANGE
            axes.add_patch(Rectangle((column - 0.48, row - 0.46), 0.96 * share, 0.92, facecolor=colour, alpha=0.55))
            axes.text(
                column, row, f"{'' if analysis.verdict.decided else '≥ '}{analysis.verdict.dimension}", ha="center", va="center", color=INK
            )
        axes.set(xlim=(-0.6, len(names) - 0.4), ylim=(len(suites) - 0.4, -0.6))
        turned = sum(map(len, names)) > 40
        axes.set_xticks(range(len(names)), names, rotation=20 if turned else 0, ha="right" if turned else "center")
        axes.set_yticks(range(len(suites)), [" + ".join(suite) for suite in suites])
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)

    caption = f"How many of the {n} dimensions each suite sees: green is all of them, a bar as long as its share otherwise."
    return Picture(inline_svg(styled_figure(0.9 + _ROW * len(suites), paint), "dimensions", "Dimensions seen by each suite"), caption)
