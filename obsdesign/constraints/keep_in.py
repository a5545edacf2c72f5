"""Staying in an area."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.constraints._given import LENGTH, format_points
from obsdesign.constraints._shapes import polygon_margins
from obsdesign.constraints.abstract import ALWAYS, AbstractConstraint, Coordinate, Moment, Span
from obsdesign.geometry import convex_corners, polygon_size
from obsdesign.signals import Point


@validate_arguments
@dataclass(frozen=True)
class KeepIn(AbstractConstraint):
    """The path stays inside a convex polygon: n_i . position <= b_i for every edge i.

    One margin per edge: the distance inside its line divided by 2 area / perimeter. Raises InputError for corners of no convex area.
    """

    corners: tuple[Point, ...]
    """Corners (m, 2) [m] of the polygon, in either sense, kept counter-clockwise."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", convex_corners("keep_in: corners", self.corners))

    def __str__(self) -> str:
        return f"KeepIn: within {format_points(self.corners)}"

    @property
    def span(self) -> Span:
        """At every instant of the path."""
        return ALWAYS

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
        return "leaves the keep-in polygon"

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return (b_i - n_i . position) / size for every edge i."""
        return polygon_margins(moment, self.corners)
