"""The map: where the paths go, what stands there, where information comes from and how well the position is known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from obsdesign.report.derived_quantities import drawing_suffix, position_covariances, segment_shares
from obsdesign.report.figures._drawing import INK, WIDTH, inline_svg, light_grid
from obsdesign.report.figures._map import Shape, draw_landmarks, draw_shapes, shapes
from obsdesign.report.names import path_in_words
from obsdesign.report.number_format import NARROW, numeral, plain
from obsdesign.scenario.schema import DESIGNED, SHORTEST, WEAVE
from obsdesign.study.record import Study

SIGMAS = 2.0  # half axes of the ellipses
_ELLIPSES = 12  # at most about so many: more hide each other and the path
_MAX_ENLARGEMENT = 1.4  # how much larger the map may become for a path that would otherwise leave it
_DASHES = ("-", "--", ":", "-.")


def path_figure(study: Study) -> str:
    """Draw the designed path over the map, coloured by the information of each segment; "" for a vehicle without x and y."""
    if not {"x", "y"} <= set(study.scenario.state_names):
        return ""
    low, high = _frame(study)
    ratio = (high - low)[1] / (high - low)[0]
    height = float(np.clip((WIDTH - 0.9) * ratio, 1.6, 5.4)) + 2.1

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot()
        _draw_map(study, axes)
        _draw_baselines(study, axes)
        _draw_ellipses(study, axes)
        _draw_path(study, figure, axes)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.set_aspect("equal", adjustable="datalim")  # the frame keeps its place: where it is too long, more of the map is shown
        axes.set_xlim(low[0], high[0], auto=True)
        axes.set_ylim(low[1], high[1], auto=True)
        _draw_arrows(study, axes, low, high)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)

    return inline_svg(f"path{drawing_suffix(study)}", f"Map of {path_in_words(study.about)}, others, beacons and limits", height, paint)


def ellipse_factor(study: Study) -> int:
    """Return by how much the ellipses are enlarged: the largest of 1, 2, 5, 10, ... that leaves them about 4 % of the map."""
    low, high = _extent(study)
    typical = float(np.median(_half_axes(study)))
    factors = [digit * 10**power for power in range(6) for digit in (1, 2, 5)]
    return max([factor for factor in factors if factor * typical <= 0.04 * float(np.max(high - low))], default=1)


def paths_beyond_frame(study: Study) -> tuple[str, ...]:
    """Names of the paths that go on beyond the frame."""
    low, high = _frame(study)
    return tuple(
        candidate.name
        for candidate in study.candidates
        if np.any((place := _positions(study, candidate.name)) < low) or np.any(place > high)
    )


def _positions(study: Study, name: str) -> np.ndarray:
    return study.candidate(name).path.x[:, list(study.problem.position)]


def _frame(study: Study) -> tuple[np.ndarray, np.ndarray]:
    """Corners (2,) of the frame [m]: what the map is about and the ellipses, with a margin."""
    low, high = _extent(study)
    place, reach = _positions(study, study.about)[_ellipse_steps(study)], ellipse_factor(study) * _half_axes(study)[:, None]
    low, high = np.minimum(low, (place - reach).min(axis=0)), np.maximum(high, (place + reach).max(axis=0))
    margin = 0.05 * float(np.max(high - low))
    return low - margin, high + margin


def _extent(study: Study) -> tuple[np.ndarray, np.ndarray]:
    """Corners (2,) [m] of the designed paths, landmarks and constraints, and of other paths that do not need a much larger map."""
    wanted = (SHORTEST, WEAVE, study.about)
    needed = [candidate.name for candidate in study.candidates if candidate.name in wanted or candidate.name.startswith(f"{DESIGNED} for ")]
    points = [_positions(study, name) for name in needed]
    points += [shape.points for shape in _shapes(study) if not shape.is_wide]
    points += [np.array([point]) for point in study.scenario.system.model.landmarks]
    low, high = np.vstack(points).min(axis=0), np.vstack(points).max(axis=0)
    size = float(np.max(high - low))
    for name in (candidate.name for candidate in study.candidates if candidate.name not in needed):
        place = _positions(study, name)
        lower, higher = np.minimum(low, place.min(axis=0)), np.maximum(high, place.max(axis=0))
        if np.max(higher - lower) <= _MAX_ENLARGEMENT * size:
            low, high = lower, higher
    return low, high


def _shapes(study: Study) -> list[Shape]:
    return shapes(study.scenario.design.constraints, study.scenario.system.model.landmarks)


def _draw_map(study: Study, axes: Axes) -> None:
    light_grid(axes)
    draw_shapes(axes, _shapes(study))
    draw_landmarks(axes, study.scenario.system.model.landmarks)


def _draw_baselines(study: Study, axes: Axes) -> None:
    names, beyond_frame = [candidate.name for candidate in study.candidates if candidate.name != study.about], paths_beyond_frame(study)
    for i, name in enumerate(names):
        text = f"{name}, leaves the map" if name in beyond_frame else name
        axes.plot(*_positions(study, name).T, color="#999999", linewidth=1.1, linestyle=_DASHES[i % len(_DASHES)], label=text, zorder=2)


def _draw_path(study: Study, figure: Figure, axes: Axes) -> None:
    place, shares = _positions(study, study.about), 100 * segment_shares(study)
    # each segment up to and including the first node of the next, so that the line has no gaps
    lines = LineCollection(
        [place[first : last + 1] for first, last in pairwise(study.main.nodes)],
        array=shares,
        cmap=_information_colours(),
        linewidths=4,
        capstyle="round",
        zorder=3,
    )
    lines.set_clim(0, float(shares.max()))
    axes.add_collection(lines)
    axes.plot(*place[0], linestyle="none", marker="o", markersize=7, markerfacecolor="white", markeredgecolor=INK, label="start", zorder=5)
    what = f"information gathered per {plain(study.scenario.time.segment)}{NARROW}s [% of all]"
    bar = figure.colorbar(lines, ax=axes, orientation="horizontal", location="top", label=what, aspect=40, shrink=0.9, pad=0.02)
    if bar.solids is not None:
        bar.solids.set(rasterized=False, edgecolor="face")  # outlines, no picture inside the picture


def _information_colours() -> LinearSegmentedColormap:
    """Viridis from yellow-green (little) to violet (much): dark is much, on screen and on paper."""
    import matplotlib as mpl

    return LinearSegmentedColormap.from_list("information", mpl.colormaps["viridis"](np.linspace(0.92, 0.0, 64)), N=64)


def _half_axes(study: Study) -> np.ndarray:
    """Larger half axis [m] of the ellipse at the end of each drawn segment."""
    return SIGMAS * np.sqrt(np.linalg.eigvalsh(position_covariances(study)[_ellipse_steps(study)])[:, -1])


def _ellipse_steps(study: Study) -> np.ndarray:
    """Steps at which an ellipse is drawn: ends of segments, about a dozen."""
    ends = study.main.nodes[1:]
    every = -(-len(ends) // _ELLIPSES)
    return ends[every - 1 :: every]


def _draw_ellipses(study: Study, axes: Axes) -> None:
    factor, place, covariances = ellipse_factor(study), _positions(study, study.about), position_covariances(study)
    text = f"position, {plain(SIGMAS)}σ" + (f", drawn {factor} times" if factor > 1 else "")
    for count, k in enumerate(_ellipse_steps(study)):
        variances, vectors = np.linalg.eigh(covariances[k])
        width, height = 2 * SIGMAS * factor * np.sqrt(variances)
        angle = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
        look = {"facecolor": "#E69F0040", "edgecolor": "#8a5f00", "linewidth": 0.9, "zorder": 2.5}
        axes.add_patch(Ellipse(tuple(place[k]), width, height, angle=angle, label="_" if count else text, **look))


def _draw_arrows(study: Study, axes: Axes, low: np.ndarray, high: np.ndarray) -> None:
    start = dict(zip(study.scenario.state_names, study.main.path.x[0].tolist(), strict=True))
    size = float(np.max(high - low))
    style = {"arrowstyle": "-|>", "color": INK, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    if "heading" in start:
        tip = _positions(study, study.about)[0] + 0.11 * size * np.array([np.cos(start["heading"]), np.sin(start["heading"])])
        axes.annotate("", xy=tuple(tip), xytext=tuple(_positions(study, study.about)[0]), arrowprops=style, zorder=6)
    if {"wind_x", "wind_y"} <= start.keys() and (speed := float(np.hypot(start["wind_x"], start["wind_y"]))) > 0:
        centre = _free_corner(study, low, high)
        half = 0.05 * size * np.array([start["wind_x"], start["wind_y"]]) / speed
        axes.annotate("", xy=tuple(centre + half), xytext=tuple(centre - half), arrowprops={**style, "color": "#0072B2"}, zorder=6)
        text = f"wind\n{numeral(speed)}{NARROW}m/s"
        axes.annotate(text, xy=tuple(centre - [0, 0.06 * size]), ha="center", va="top", fontsize=9, color="#0072B2", zorder=6)


def _free_corner(study: Study, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The point near a corner of the frame that is farthest from everything drawn."""
    size = high - low
    taken = np.vstack([_positions(study, candidate.name) for candidate in study.candidates] + [shape.middle for shape in _shapes(study)])
    corners = [low + size * [across, up] for across in (0.12, 0.88) for up in (0.24, 0.9)]
    return max(corners, key=lambda corner: float(np.min(np.hypot(*(taken - corner).T))))
