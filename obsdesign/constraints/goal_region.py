"""Arriving anywhere in an area."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.constraints._given import LENGTH, format_points
from obsdesign.constraints._shapes import polygon_margins
from obsdesign.constraints.abstract import AT_END, AbstractConstraint, Coordinate, Moment, Span
from obsdesign.geometry import convex_corners, polygon_size
from obsdesign.signals import Point


@validate_arguments
@dataclass(frozen=True)
class GoalRegion(AbstractConstraint):
    """The path ends inside a convex polygon: n_i . position(t_N) <= b_i for every edge i.

    One margin per edge: the distance inside its line divided by 2 area / perimeter. Raises InputError for corners of no convex area.
    """

    corners: tuple[Point, ...]
    """Corners (m, 2) [m] of the polygon, in either sense, kept counter-clockwise."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", convex_corners("goal_region: corners", self.corners))

    def __str__(self) -> str:
        return f"GoalRegion: within {format_points(self.corners)}"

    @property
    def span(self) -> Span:
        """At the end of the path, t_N."""
        return AT_END

    @property
    def states(self) -> tuple[str, ...]:
        """The position, (x, y)."""
        return ("x", "y")

    @property
    def size(self) -> tuple[float, str]:
        """2 area / perimeter of the polygon [m]."""
        return polygon_size(self.corners), LENGTH

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return "misses the goal region"

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return (b_i - n_i . position) / size for every edge i."""
        return polygon_margins(moment, self.corners)
