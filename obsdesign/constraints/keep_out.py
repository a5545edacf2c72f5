"""Staying out of a circle."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_pair
from obsdesign.constraints._given import LENGTH, as_size, format_numbers
from obsdesign.constraints._shapes import outside_disc
from obsdesign.constraints.abstract import ALWAYS, AbstractConstraint, Coordinate, Moment, Span
from obsdesign.signals import Point


@validate_arguments
@dataclass(frozen=True)
class KeepOut(AbstractConstraint):
    """The path stays outside a circle: |position - centre| >= radius.

    margin = |position - centre| / radius - 1, rounded within 0.001 radius of the centre, where it has a derivative.
    Raises InputError for other values.
    """

    centre: Point
    """Middle of the circle (x, y) [m]."""
    radius: float
    """Radius of the circle [m], > 0."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", as_pair("keep_out: centre", self.centre))
        object.__setattr__(self, "radius", as_size("keep_out: radius", self.radius))

    def __str__(self) -> str:
        return f"KeepOut: at least {format_numbers(self.radius)} m from {format_numbers(*self.centre)}"

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
        """The radius [m]."""
        return self.radius, LENGTH

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return "enters a keep-out circle"

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return |position - centre| / radius - 1, rounded at the centre."""
        return [outside_disc(moment, self.centre, self.radius)]
