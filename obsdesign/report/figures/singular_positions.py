"""How near every position comes to hiding the state: the singular set of a planar configuration."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from obsdesign.arguments import validate_arguments
from obsdesign.information.position_grid import SingularSet
from obsdesign.report.figures._drawing import INK, VERMILLION, WIDTH, styled_figure

_DECADES = 4  # below the largest value, beyond which all is drawn alike


@validate_arguments
def singular(positions: SingularSet) -> Figure:
    """Draw how near every position comes to hiding the state, dark where it does, with the landmarks and the circle through three of them.

    Arguments:
        positions: what `singular_set` returned.
    Source: Belo, Salaris and Bicchi 2010, figure 2.
    """
    return styled_figure(0.85 * WIDTH, lambda figure: _paint(figure, positions))


def _paint(figure: Figure, positions: SingularSet) -> None:
    axes = figure.subplots()
    largest = float(np.nanmax(positions.nearness, initial=1e-300))
    lowest = largest * 10.0**-_DECADES
    values = np.maximum(positions.nearness, lowest)
    mesh = axes.pcolormesh(
        positions.x, positions.y, values, norm=LogNorm(lowest, largest), cmap="cividis", shading="nearest", rasterized=True
    )
    figure.colorbar(mesh, ax=axes, label="smallest singular value", shrink=0.8)
    if positions.circle is not None:
        axes.add_patch(Circle(positions.circle.centre, positions.circle.radius, fill=False, edgecolor=VERMILLION, linewidth=1.0))
    for x, y in positions.landmarks:
        axes.plot(x, y, marker="^", color=VERMILLION, markeredgecolor=INK, linestyle="none")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.set_xlim(positions.x[0], positions.x[-1])
    axes.set_ylim(positions.y[0], positions.y[-1])
