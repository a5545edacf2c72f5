"""Arriving."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_pair
from obsdesign.constraints._given import LENGTH, as_size, format_numbers
from obsdesign.constraints._shapes import outside_disc
from obsdesign.constraints.abstract import AT_END, AbstractConstraint, Coordinate, Moment, Span
from obsdesign.signals import Point


@validate_arguments
@dataclass(frozen=True)
class Goal(AbstractConstraint):
    """The path ends near a point: |position(t_N) - point| <= tolerance.

    margin = 1 - |position - point| / tolerance, rounded within 0.001 tolerance of the point, where it has a derivative.
    Raises InputError for other values.
    """

    point: Point
    """Where the path is to end (x, y) [m]."""
    tolerance: float
    """How far from the point it may end [m], > 0."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", as_pair("goal: point", self.point))
        object.__setattr__(self, "tolerance", as_size("goal: tolerance", self.tolerance))

    def __str__(self) -> str:
        return f"Goal: within {format_numbers(self.tolerance)} m of {format_numbers(*self.point)}"

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
        """The tolerance [m]."""
        return self.tolerance, LENGTH

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return "misses the goal"

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return 1 - |position - point| / tolerance, rounded at the point."""
        return [-outside_disc(moment, self.point, self.tolerance)]
