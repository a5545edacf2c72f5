"""Arriving with a heading."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_pair
from obsdesign.constraints._given import as_angle, as_half_angle, as_size, format_numbers
from obsdesign.constraints._shapes import outside_disc, within_angle
from obsdesign.constraints.abstract import AT_END, AbstractConstraint, Coordinate, Moment, Span
from obsdesign.signals import Point


@validate_arguments
@dataclass(frozen=True)
class GoalPose(AbstractConstraint):
    """The path ends near a point with a given heading.

    |position(t_N) - point| <= tolerance and |heading(t_N) - heading| <= heading_tolerance, the latter to whole turns.
    Two margins: 1 - |position - point| / tolerance, and with c(a) = 2 |sin(a / 2)|, T = heading_tolerance,
    (c(T) - c(heading error)) / (T cos(T / 2)), whose slope at the edge is 1 / T; each is rounded within 0.001 of its tolerance of
    the aim. A margin of 1 is worth one tolerance, of position [m] or of heading [rad]. Raises InputError for other values.
    """

    point: Point
    """Where the path is to end (x, y) [m]."""
    heading: float
    """Which way the vehicle is to look there [rad]."""
    tolerance: float
    """How far from the point it may end [m], > 0."""
    heading_tolerance: float
    """How far from the heading it may end [rad], in (0, pi)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", as_pair("goal_pose: point", self.point))
        object.__setattr__(self, "heading", as_angle("goal_pose: heading", self.heading))
        object.__setattr__(self, "tolerance", as_size("goal_pose: tolerance", self.tolerance))
        object.__setattr__(self, "heading_tolerance", as_half_angle("goal_pose: heading_tolerance", self.heading_tolerance))

    def __str__(self) -> str:
        place = f"within {format_numbers(self.tolerance)} m of {format_numbers(*self.point)}"
        return f"GoalPose: {place}, heading {format_numbers(self.heading)} +- {format_numbers(self.heading_tolerance)} rad"

    @property
    def span(self) -> Span:
        """At the end of the path, t_N."""
        return AT_END

    @property
    def states(self) -> tuple[str, ...]:
        """The position and the heading, (x, y, heading)."""
        return ("x", "y", "heading")

    @property
    def size(self) -> tuple[float, str]:
        """One tolerance, of position or of heading."""
        return 1.0, "tolerances"

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return "misses the goal pose"

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return 1 - |position - point| / tolerance, and (c(T) - c(heading error)) / (T cos(T / 2)) with T = heading_tolerance."""
        position = -outside_disc(moment, self.point, self.tolerance)
        return [position, within_angle(moment.state["heading"], self.heading, self.heading_tolerance)]
