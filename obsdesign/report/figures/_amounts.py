"""Amounts by colour: one row per sensor, one column per segment, with dots where a sensor is on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from obsdesign.report.figures._drawing import INK, QUIET, styled_figure

_LOWEST, _HIGHEST = 1e-2, 1e2  # amounts between which colours differ
_DOT: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 3.5, "color": "white", "markeredgecolor": INK}


def draw_amounts(
    amounts: np.ndarray, chosen: np.ndarray, names: Sequence[str], t: Sequence[float] | np.ndarray | None, label: str
) -> Figure:
    """Draw amounts (S, K), infinite where the rules forbid something, with dots where `chosen` (K, S) is on."""
    times = np.arange(len(chosen) + 1.0) if t is None else np.asarray(t)

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        mesh = _draw_colours(axes, amounts, times)
        _draw_dots(axes, chosen, times)
        axes.set_yticks(range(len(names)), names)
        axes.set(ylim=(len(names) - 0.5, -0.5), xlim=(times[0], times[-1]), xlabel="segment [–]" if t is None else "time [s]")
        axes.tick_params(axis="y", length=0)
        for side in axes.spines.values():
            side.set_visible(False)
        _draw_bar(figure, axes, mesh, label)
        figure.legend(handles=_keys(bool(np.isfinite(amounts).all())), loc="outside lower center", ncols=2)

    return styled_figure(2.0 + 0.36 * len(names), paint)


def _draw_colours(axes: Axes, amounts: np.ndarray, times: np.ndarray) -> QuadMesh:
    """Amounts (S, K) by colour, grey where the rules forbid to decide otherwise."""
    possible = np.isfinite(amounts)
    largest = float(amounts[possible].max(initial=0.0))
    high = min(max(largest, 10 * _LOWEST), _HIGHEST)
    rows = np.arange(len(amounts) + 1) - 0.5
    impossible = np.ma.masked_where(possible, np.ones_like(amounts))
    axes.pcolormesh(times, rows, impossible, cmap=ListedColormap(["#e4e4e4"]), edgecolors="white", linewidth=0.8)
    shown = np.ma.masked_where(~possible, np.clip(np.where(possible, amounts, 0.0), _LOWEST, high))
    return axes.pcolormesh(times, rows, shown, cmap="Purples", norm=LogNorm(_LOWEST, high), edgecolors="white", linewidth=0.8)


def _draw_dots(axes: Axes, chosen: np.ndarray, times: np.ndarray) -> None:
    middle = (times[:-1] + times[1:]) / 2
    for s, on in enumerate(chosen.T):
        axes.plot(middle[on], np.full(on.sum(), s), **_DOT)


def _draw_bar(figure: Figure, axes: Axes, mesh: QuadMesh, label: str) -> None:
    bar = figure.colorbar(mesh, ax=axes, orientation="horizontal", location="top", label=label, aspect=40, shrink=0.9, pad=0.02)
    bar.ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    if bar.solids is not None:
        bar.solids.set(rasterized=False, edgecolor="face")  # outlines, no picture inside the picture


def _keys(all_possible: bool) -> list[Artist]:
    handles: list[Artist] = [Line2D([], [], label="is on", **_DOT)]
    if not all_possible:
        handles.append(Patch(facecolor="#e4e4e4", edgecolor=QUIET, linewidth=0.4, label="impossible: the rules forbid it"))
    return handles
