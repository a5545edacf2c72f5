"""How near a motion comes to hiding the state, over time."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from obsdesign.information.singular_motion import Singularities
from obsdesign.report.figures._drawing import BLUE, ORANGE, VERMILLION, Picture, inline_svg, legend_below, light_grid, styled_figure

_LEAST = 1e-16  # what is drawn of 0 on a logarithmic axis


def picture(motion: Singularities) -> Picture:
    """Return the smallest singular value over the largest at each instant, stretches that hide the state shaded."""

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        light_grid(axes)
        for i, interval in enumerate(motion.hidden):
            axes.axvspan(interval.start, interval.end, color=ORANGE, alpha=0.35, linewidth=0, label="hidden" if i == 0 else None)
        axes.plot(motion.t, np.maximum(motion.nearness, _LEAST), color=BLUE, label="smallest over largest")
        axes.axhline(motion.tolerance, color=VERMILLION, linestyle="--", linewidth=1.0, label="counts as 0")
        axes.set(xlabel="t [s]", ylabel="singular value [–]", yscale="log")
        legend_below(figure, axes, 3)

    caption = (
        f"Singular values of the gradients of the outputs and of their derivatives up to order {motion.orders}, state by state in units of "
        "what they amount to along the path. 0 is a motion that hides a combination of states for as long as it goes on."
    )
    return Picture(inline_svg(styled_figure(3.0, paint), "nearness", "How near the motion comes to hiding the state"), caption)
