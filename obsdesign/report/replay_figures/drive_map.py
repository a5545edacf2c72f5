"""Where the vehicle went, how well it could be known there, and which beacons that hung on."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from obsdesign.report.figures._drawing import FAINT, INK, VERMILLION, Picture, inline_svg, light_grid, styled_figure
from obsdesign.report.number_format import NARROW, plain
from obsdesign.study.log_study import LogStudy

_MOST_SEGMENTS, _ELLIPSES = 1200, 24
_SMALLEST_SHARE = 0.012  # of the map's size: what the median ellipse is enlarged to
_FACTORS = (1, 2, 5, 10, 20, 50, 100, 200, 500)


def picture(study: LogStudy) -> Picture | None:
    """Return the map, None where the vehicle has no position."""
    drive = study.replay
    names = drive.run.states
    if not {"x", "y"} <= set(names):
        return None
    places = [names.index("x"), names.index("y")]
    factor = _enlargement(drive.path.x[:, places], drive.bound[:, places])

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes = figure.add_subplot()
        _draw_path(figure, axes, study, places)
        _draw_ellipses(axes, study, places, factor)
        _draw_landmarks(axes, study)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.margins(0.08)
        axes.set_aspect("equal", adjustable="datalim")

    sizes = f" {plain(factor)} times as large" if factor > 1 else ""
    caption = (
        "The path, coloured by what no filter is below (1σ of the position); ellipses: 2σ of the filter's own covariance,"
        f"{sizes or ' to scale'}. A triangle is a beacon; the larger it is, the more the error grows without it."
    )
    return Picture(inline_svg(styled_figure(4.6, paint), "drive", "Map of the drive coloured by its bound"), caption)


def _enlargement(points: np.ndarray, bound: np.ndarray) -> int:
    span = float(np.ptp(points, axis=0).max()) or 1.0
    size = 2 * float(np.median(np.linalg.norm(bound, axis=1)))
    return next((factor for factor in _FACTORS if factor * size >= _SMALLEST_SHARE * span), _FACTORS[-1])


def _draw_path(figure: Figure, axes: Axes, study: LogStudy, places: list[int]) -> None:
    drive = study.replay
    every = max(len(drive.t) // _MOST_SEGMENTS, 1)
    chosen = np.searchsorted(drive.path.t, drive.t[::every])
    points, sizes = drive.path.x[chosen][:, places], np.linalg.norm(drive.bound[::every][:, places], axis=1)
    segments = np.stack([points[:-1], points[1:]], axis=1)
    light_grid(axes)
    low, high = (float(value) for value in np.quantile(sizes, [0.02, 0.98]))
    norm = LogNorm(low, max(high, 1.02 * low))
    lines = LineCollection([*segments], cmap="viridis_r", norm=norm, linewidth=2.0, zorder=3)
    lines.set_array(sizes[:-1])
    axes.add_collection(lines)
    axes.autoscale_view()
    bar = figure.colorbar(lines, ax=axes, shrink=0.8)
    ticks = [tick for tick in np.outer(10.0 ** np.arange(-4, 5), (1.0, 2.0, 5.0)).ravel() if low <= tick <= high]
    ticks = ticks if len(ticks) > 1 else [norm.vmin, norm.vmax]
    bar.set_ticks(ticks, labels=[f"{tick:.3g}" for tick in ticks])
    bar.minorticks_off()
    bar.set_label(f"bound, 1σ{NARROW}[m]")


def _draw_ellipses(axes: Axes, study: LogStudy, places: list[int], factor: int) -> None:
    drive = study.replay
    for k in np.linspace(0, len(drive.t) - 1, _ELLIPSES + 2).astype(int)[1:-1]:
        values, vectors = np.linalg.eigh(drive.covariance[k][np.ix_(places, places)])
        width, height = 4 * factor * np.sqrt(np.maximum(values, 0.0))
        angle = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
        place = drive.estimate[k, places]
        axes.add_patch(Ellipse((place[0], place[1]), width, height, angle=angle, fill=False, edgecolor=INK, linewidth=0.7, zorder=4))


def _draw_landmarks(axes: Axes, study: LogStudy) -> None:
    growths = study.growth
    for name, (x, y) in study.setup.landmarks.items():
        size = 5 + 30 * min(growths.get(name, 1.0) - 1, 0.5)
        axes.plot(x, y, linestyle="none", marker="^", markersize=size, color=VERMILLION, markeredgecolor=INK, alpha=0.85, zorder=5)
        if len(study.setup.landmarks) <= 16:
            look = {"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": FAINT, "linewidth": 0.4, "alpha": 0.8}
            axes.annotate(name, (x, y), xytext=(0, 5 + size / 2), textcoords="offset points", ha="center", fontsize=8, bbox=look, zorder=6)
