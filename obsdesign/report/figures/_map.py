"""What stands on a map: beacons, goals, areas and circles of the constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Patch, Polygon

from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.constraints.circle_clearance import CircleClearance
from obsdesign.constraints.goal import Goal
from obsdesign.constraints.goal_pose import GoalPose
from obsdesign.constraints.goal_region import GoalRegion
from obsdesign.constraints.keep_in import KeepIn
from obsdesign.constraints.keep_out import KeepOut
from obsdesign.constraints.keep_out_polygon import KeepOutPolygon
from obsdesign.constraints.loiter import Loiter
from obsdesign.constraints.max_range import MaxRange
from obsdesign.constraints.stand_off import StandOff
from obsdesign.constraints.via import Via
from obsdesign.geometry import circle_through
from obsdesign.report.figures._drawing import BLUE, GREEN, INK, PURPLE, QUIET, VERMILLION
from obsdesign.report.number_format import NARROW, plain
from obsdesign.signals import Point

_STYLES = {
    "goal": {"facecolor": "#009E7330", "edgecolor": GREEN},
    "keep out": {"facecolor": "#D55E0030", "edgecolor": VERMILLION, "hatch": "///"},
    "keep in": {"facecolor": "none", "edgecolor": BLUE, "linestyle": "-."},
    "via": {"facecolor": "#CC79A730", "edgecolor": PURPLE},
    "loiter": {"facecolor": "#CC79A720", "edgecolor": PURPLE, "linestyle": "--"},
    "stand-off": {"facecolor": "#00000010", "edgecolor": QUIET, "linestyle": "--"},
    "range limit": {"facecolor": "none", "edgecolor": QUIET, "linestyle": ":"},
    "the beacons' circle": {"facecolor": "none", "edgecolor": VERMILLION, "linestyle": (0, (6, 2, 1, 2))},
}


@dataclass(frozen=True)
class Shape:
    """A disc (centre, radius) or a polygon (corners) of a kind; is_wide: so large that the map need not show all of it."""

    kind: str
    label: str
    centre: Point = (0.0, 0.0)
    radius: float = 0.0
    corners: tuple[Point, ...] = ()
    heading: float | None = None
    is_wide: bool = False

    @property
    def points(self) -> np.ndarray:
        """Corners (k, 2) [m] of a box about it."""
        if self.corners:
            return np.array(self.corners)
        return np.array([self.centre]) + np.outer([-1, 1], [self.radius, self.radius])

    @property
    def middle(self) -> np.ndarray:
        """A point (2,) [m] within."""
        return self.points.mean(axis=0)

    def patch(self, label: str) -> Patch:
        """Return what is drawn."""
        look = {"label": label, "zorder": 1, **_STYLES[self.kind]}
        return Polygon(np.array(self.corners), closed=True, **look) if self.corners else Circle(self.centre, self.radius, **look)


def shapes(constraints: Sequence[AbstractConstraint], landmarks: Sequence[Point]) -> list[Shape]:
    """Return every shape that constraints draw on a map."""
    return [shape for constraint in constraints for shape in _constraint_shapes(constraint, landmarks)]


def draw_shapes(axes: Axes, map_shapes: Sequence[Shape]) -> None:
    """Draw shapes, one entry in the legend for each kind and size."""
    drawn: set[str] = set()
    for shape in map_shapes:
        axes.add_patch(shape.patch("_" if shape.label in drawn else shape.label))
        drawn.add(shape.label)
        if shape.heading is not None:
            tip = np.array(shape.centre) + 2.2 * shape.radius * np.array([np.cos(shape.heading), np.sin(shape.heading)])
            style = {"arrowstyle": "-|>", "color": GREEN, "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", xy=tuple(tip), xytext=shape.centre, arrowprops=style, zorder=4)


def draw_landmarks(axes: Axes, landmarks: Sequence[Point]) -> None:
    """Draw what the sensors look at."""
    if landmarks:
        axes.plot(*np.array(landmarks).T, linestyle="none", marker="^", markersize=8, color=INK, label="beacon", zorder=4)


def _constraint_shapes(constraint: AbstractConstraint, landmarks: Sequence[Point]) -> list[Shape]:  # noqa: PLR0911  # one for each kind
    match constraint:
        case Goal(point=point, tolerance=radius):
            return [_disc("goal", point, radius)]
        case GoalPose(point=point, tolerance=radius, heading=heading):
            return [Shape("goal", _label_with_radius("goal, arriving as the arrow", radius), point, radius, heading=heading)]
        case GoalRegion(corners=corners):
            return [Shape("goal", "goal", corners=corners)]
        case KeepOut(centre=centre, radius=radius):
            return [_disc("keep out", centre, radius)]
        case KeepOutPolygon(corners=corners):
            return [Shape("keep out", "keep out", corners=corners)]
        case KeepIn(corners=corners):
            return [Shape("keep in", "keep in", corners=corners)]
        case Via(point=point, tolerance=radius):
            return [_disc("via", point, radius)]
        case Loiter(centre=centre, radius=radius):
            return [_disc("loiter", centre, radius)]
        case StandOff(distance=distance, landmarks=points):
            return [_disc("stand-off", point, distance) for point in points or landmarks]
        case MaxRange(distance=distance, landmarks=points):
            return [
                Shape("range limit", _label_with_radius("range limit", distance), point, distance, is_wide=True)
                for point in points or landmarks
            ]
        case CircleClearance(landmarks=points):
            centre, radius = circle_through(points or landmarks)
            return [Shape("the beacons' circle", "the beacons' circle", centre, radius, is_wide=True)]
        case _:
            return []


def _disc(kind: str, centre: Point, radius: float) -> Shape:
    return Shape(kind, _label_with_radius(kind, radius), centre, radius)


def _label_with_radius(kind: str, radius: float) -> str:
    return f"{kind}, {plain(radius)}{NARROW}m"
