"""The map: where paths go, what stands there, where information comes from and how well the position is known."""

from __future__ import annotations

from itertools import pairwise

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from obsdesign.arguments import validate_arguments
from obsdesign.design.record import Design
from obsdesign.errors import InputError
from obsdesign.information.blocks import Information
from obsdesign.information.contribution_shares import contributions
from obsdesign.report.derived_quantities import drawing_suffix, position_covariances, segment_shares
from obsdesign.report.figures._drawing import INK, Picture, inline_svg, light_grid, styled_figure
from obsdesign.report.figures._map import draw_landmarks, draw_shapes, shapes
from obsdesign.report.figures._map_contents import SIGMAS, MapContents
from obsdesign.report.names import path_in_words
from obsdesign.report.number_format import NARROW, numeral, plain
from obsdesign.scenario.path_names import DESIGNED, SHORTEST, WEAVE
from obsdesign.study.record import Study
from obsdesign.trajectory import Trajectory

_MAX_SEGMENTS = 40  # of a path alone: so many colours still tell where information comes from
_DASHES = ("-", "--", ":", "-.")


@validate_arguments
def path(design: Design) -> Figure:
    """Draw a designed path over the map, coloured by where the information about its weakest direction comes from.

    Arguments:
        design: the design, with a path, of a vehicle with the states x and y.
    Raises InputError for a design without a path, or a vehicle without x and y.
    """
    names = design.problem.system.model.state_names
    if design.trajectory is None or design.information is None:
        raise InputError(f"design: has no path to draw: {design.status.value}")
    if not {"x", "y"} <= set(names):
        raise InputError(f"design: the states are {', '.join(names)}: a map needs x and y")
    return draw_map(_contents_of_design(design, design.trajectory, design.information))


def picture(study: Study) -> Picture | None:
    """Return the map of the path that the study is about, among others; None for a vehicle without x and y."""
    if not {"x", "y"} <= set(study.scenario.state_names):
        return None
    contents = contents_of(study)
    description = f"Map of {path_in_words(study.about)}, others, beacons and limits"
    return Picture(inline_svg(draw_map(contents), f"path{drawing_suffix(study)}", description), _caption(study, contents.ellipse_factor))


def contents_of(study: Study) -> MapContents:
    """Return what stands on the map of a study."""
    columns, scenario = list(study.problem.position), study.scenario
    names = [candidate.name for candidate in study.candidates if candidate.name != study.about]
    landmarks = scenario.system.model.landmarks
    return MapContents(
        place=study.main.path.x[:, columns],
        nodes=study.main.nodes,
        shares=segment_shares(study),
        seconds=scenario.time.segment,
        start=dict(zip(scenario.state_names, study.main.path.x[0].tolist(), strict=True)),
        shapes=shapes(scenario.design.constraints, landmarks),
        landmarks=landmarks,
        others={name: study.candidate(name).path.x[:, columns] for name in names},
        needed=frozenset(name for name in names if name in (SHORTEST, WEAVE) or name.startswith(f"{DESIGNED} for ")),
        covariances=position_covariances(study),
    )


def _contents_of_design(design: Design, trajectory: Trajectory, information: Information) -> MapContents:
    problem = design.problem
    every = -(-trajectory.steps // _MAX_SEGMENTS)
    nodes = np.append(np.arange(0, trajectory.steps, every), trajectory.steps)
    shares = contributions(problem.system, information, None, problem.units).weakest_shares.sum(axis=1)
    landmarks = problem.system.model.landmarks
    return MapContents(
        place=trajectory.x[:, list(problem.position)],
        nodes=nodes,
        shares=np.add.reduceat(shares, nodes[:-1]),
        seconds=every * trajectory.step,
        start=dict(zip(problem.system.model.state_names, trajectory.x[0].tolist(), strict=True)),
        shapes=shapes(problem.constraints, landmarks),
        landmarks=landmarks,
    )


def _caption(study: Study, factor: int) -> str:
    """Say what the map's colours and ellipses mean."""
    seconds = plain(study.scenario.time.segment)
    size = f"enlarged {factor} times" if factor > 1 else "to scale"
    return (
        f"Dark is where most is learnt about what is known least: the colour is v′Wₖv / v′Wv, the share that a segment of "
        f"{seconds}{NARROW}s adds to what all sensors know in the weakest direction v of {path_in_words(study.about)}. Ellipses are "
        f"{plain(SIGMAS)}σ of the position by the posterior Cramér-Rao bound with the chosen schedule, {size}."
    )


def draw_map(contents: MapContents) -> Figure:
    """Draw a map."""

    def paint(figure: Figure) -> None:
        """Draw on the figure."""
        axes, (low, high) = figure.add_subplot(), contents.frame
        light_grid(axes)
        draw_shapes(axes, contents.shapes)
        draw_landmarks(axes, contents.landmarks)
        _draw_others(contents, axes)
        _draw_ellipses(contents, axes)
        _draw_path(contents, figure, axes)
        axes.set(xlabel="x [m]", ylabel="y [m]")
        axes.set_aspect("equal", adjustable="datalim")  # the frame keeps its place: where it is too long, more of the map is shown
        axes.set_xlim(low[0], high[0], auto=True)
        axes.set_ylim(low[1], high[1], auto=True)
        _draw_arrows(contents, axes)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)

    return styled_figure(contents.height, paint)


def _draw_others(contents: MapContents, axes: Axes) -> None:
    for i, (name, place) in enumerate(contents.others.items()):
        text = f"{name}, leaves the map" if contents.leaves(name) else name
        axes.plot(*place.T, color="#999999", linewidth=1.1, linestyle=_DASHES[i % len(_DASHES)], label=text, zorder=2)


def _draw_path(contents: MapContents, figure: Figure, axes: Axes) -> None:
    place, shares = contents.place, 100 * contents.shares
    # each segment up to and including the first node of the next, so that the line has no gaps
    parts = [place[first : last + 1] for first, last in pairwise(contents.nodes)]
    lines = LineCollection(parts, array=shares, cmap=_information_colours(), linewidths=4, capstyle="round", zorder=3)
    lines.set_clim(0, float(shares.max()))
    axes.add_collection(lines)
    axes.plot(*place[0], linestyle="none", marker="o", markersize=7, markerfacecolor="white", markeredgecolor=INK, label="start", zorder=5)
    what = f"information gathered per {plain(contents.seconds)}{NARROW}s [% of all]"
    bar = figure.colorbar(lines, ax=axes, orientation="horizontal", location="top", label=what, aspect=40, shrink=0.9, pad=0.02)
    if bar.solids is not None:
        bar.solids.set(rasterized=False, edgecolor="face")  # outlines, no picture inside the picture


def _information_colours() -> LinearSegmentedColormap:
    """Viridis from yellow-green (little) to violet (much): dark is much, on screen and on paper."""
    return LinearSegmentedColormap.from_list("information", mpl.colormaps["viridis"](np.linspace(0.92, 0.0, 64)), N=64)


def _draw_ellipses(contents: MapContents, axes: Axes) -> None:
    factor, covariances = contents.ellipse_factor, contents.covariances
    if covariances is None:
        return
    text = f"position, {plain(SIGMAS)}σ" + (f", drawn {factor} times" if factor > 1 else "")
    for count, k in enumerate(contents.ellipse_steps):
        variances, vectors = np.linalg.eigh(covariances[k])
        width, height = 2 * SIGMAS * factor * np.sqrt(variances)
        angle = float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0])))
        look = {"facecolor": "#E69F0040", "edgecolor": "#8a5f00", "linewidth": 0.9, "zorder": 2.5}
        axes.add_patch(Ellipse(tuple(contents.place[k]), width, height, angle=angle, label="_" if count else text, **look))


def _draw_arrows(contents: MapContents, axes: Axes) -> None:
    start, (low, high) = contents.start, contents.frame
    size = float(np.max(high - low))
    style = {"arrowstyle": "-|>", "color": INK, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    if "heading" in start:
        tip = contents.place[0] + 0.11 * size * np.array([np.cos(start["heading"]), np.sin(start["heading"])])
        axes.annotate("", xy=tuple(tip), xytext=tuple(contents.place[0]), arrowprops=style, zorder=6)
    if {"wind_x", "wind_y"} <= start.keys() and (speed := float(np.hypot(start["wind_x"], start["wind_y"]))) > 0:
        centre = _free_corner(contents)
        half = 0.05 * size * np.array([start["wind_x"], start["wind_y"]]) / speed
        axes.annotate("", xy=tuple(centre + half), xytext=tuple(centre - half), arrowprops={**style, "color": "#0072B2"}, zorder=6)
        text = f"wind\n{numeral(speed)}{NARROW}m/s"
        axes.annotate(text, xy=tuple(centre - [0, 0.06 * size]), ha="center", va="top", fontsize=9, color="#0072B2", zorder=6)


def _free_corner(contents: MapContents) -> np.ndarray:
    """The point near a corner of the frame that is farthest from everything drawn."""
    low, high = contents.frame
    size = high - low
    taken = np.vstack([contents.place, *contents.others.values(), *(shape.middle for shape in contents.shapes)])
    corners = [low + size * [across, up] for across in (0.12, 0.88) for up in (0.24, 0.9)]
    return max(corners, key=lambda corner: float(np.min(np.hypot(*(taken - corner).T))))
