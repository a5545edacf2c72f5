"""Numbers of many runs over one thing that was varied, a panel for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from obsdesign.report.figures._drawing import BLUE, INK, VERMILLION, Picture, inline_svg, light_grid, styled_figure
from obsdesign.report.number_format import plain

_LONG = 14  # letters of a value beside which there is no room for another


@dataclass(frozen=True, eq=False)
class Panel:
    """What one panel shows: label, with its unit, and the number of each run (runs,), nan where it has none."""

    label: str
    values: np.ndarray


def picture(name: str, key: str, varied: Sequence[object], panels: Sequence[Panel]) -> Picture:
    """Return a dot for each run, and the mean of the runs that share a value of the key.

    name: prefix of ids; varied: the key's value in each run (runs,), numbers at their place, anything else side by side.
    """
    distinct = list(dict.fromkeys(map(_as_label, varied)))
    is_numeric = all(isinstance(value, int | float) and not isinstance(value, bool) for value in varied)
    labels = list(map(_as_label, varied))
    places = np.array(varied, dtype=float) if is_numeric else np.array([distinct.index(label) for label in labels], dtype=float)

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for axes, panel in zip(grid, panels, strict=True):
            _draw_panel(axes, places, panel)
        grid[-1].set_xlabel(key)
        if is_numeric:
            grid[-1].xaxis.set_major_locator(MaxNLocator(6))
        else:
            turned = max(map(len, distinct)) * len(distinct) > 4 * _LONG
            grid[-1].set_xticks(range(len(distinct)), distinct, rotation=20 if turned else 0, ha="right" if turned else "center")

    caption = f"A dot is a run; the line is the mean of the runs with the same {key}, whatever else was varied."
    return Picture(inline_svg(styled_figure(0.7 + 1.5 * len(panels), paint), name, f"Numbers of all runs over {key}"), caption)


def _draw_panel(axes: Axes, places: np.ndarray, panel: Panel) -> None:
    """Draw the dots and the means of one number."""
    light_grid(axes)
    is_there = np.isfinite(panel.values)
    axes.plot(places[is_there], panel.values[is_there], linestyle="none", marker="o", markersize=4, color=BLUE, alpha=0.6, zorder=3)
    x = np.unique(places[is_there])
    means = [float(np.mean(panel.values[is_there & (places == place)])) for place in x]
    axes.plot(x, means, color=VERMILLION, linewidth=1.3)
    axes.set_title(panel.label, color=INK)
    axes.yaxis.set_major_locator(MaxNLocator(4))


def _as_label(value: object) -> str:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return plain(value)
    return ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
