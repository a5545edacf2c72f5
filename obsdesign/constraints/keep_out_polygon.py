"""Staying out of an area with straight edges."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.constraints._given import LENGTH, format_points
from obsdesign.constraints._shapes import outside_polygon, widening
from obsdesign.constraints.abstract import ALWAYS, AbstractConstraint, Coordinate, Moment, Span
from obsdesign.geometry import convex_corners, polygon_size
from obsdesign.signals import Point


@validate_arguments
@dataclass(frozen=True)
class KeepOutPolygon(AbstractConstraint):
    """The path stays outside a convex polygon: max_i (n_i . position - b_i) >= 0 over its m edges.

    margin = (e log(sum_i exp(s_i / e)) - e log m) / size, with the distances s_i = n_i . position - b_i of the edges' lines,
    size = 2 area / perimeter and e = 0.02 size. It is a smooth maximum, at the price of `widening` = e log m metres: nothing inside
    the polygon is allowed; all that lies `widening` or more beyond the line of some edge is.
    Raises InputError for corners of no convex area.
    """

    corners: tuple[Point, ...]
    """Corners (m, 2) [m] of the polygon, in either sense."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", convex_corners("keep_out_polygon: corners", self.corners))

    def __str__(self) -> str:
        return f"KeepOutPolygon: outside {format_points(self.corners)}, widened by {self.widening:.3g} m"

    @property
    def widening(self) -> float:
        """By how much [m] the polygon's edges would have to move outwards to enclose all that is forbidden."""
        return widening(self.corners)

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
        """2 area / perimeter of the polygon [m], not widened."""
        return polygon_size(self.corners), LENGTH

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return "enters a keep-out polygon"

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return (e log(sum_i exp(s_i / e)) - e log m) / size, a smooth maximum of the distances s_i of the m edges' lines."""
        return [outside_polygon(moment, self.corners)]
