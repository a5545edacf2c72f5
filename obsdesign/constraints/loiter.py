"""Staying near a point for a while."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_pair
from obsdesign.constraints._given import LENGTH, as_size, as_window, format_numbers, format_window
from obsdesign.constraints._shapes import outside_disc
from obsdesign.constraints.abstract import AbstractConstraint, Coordinate, Moment, Span
from obsdesign.signals import Point


@validate_arguments
@dataclass(frozen=True)
class Loiter(AbstractConstraint):
    """The vehicle stays inside a circle for a stretch of time: |position(t) - centre| <= radius at every t from first to last.

    margin = 1 - |position - centre| / radius, rounded within 0.001 radius of the centre, where it has a derivative.
    Raises InputError for other values.
    """

    centre: Point
    """Middle of the circle (x, y) [m]."""
    radius: float
    """Radius of the circle [m], > 0."""
    first: float
    """From when on it counts [s], >= 0."""
    last: float | None = None
    """Until when it counts [s], >= first; None = to the end of the path."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", as_pair("loiter: centre", self.centre))
        object.__setattr__(self, "radius", as_size("loiter: radius", self.radius))
        first, last = as_window("loiter", self.first, self.last)
        object.__setattr__(self, "first", first)
        object.__setattr__(self, "last", last)

    def __str__(self) -> str:
        return f"Loiter: within {format_numbers(self.radius)} m of {format_numbers(*self.centre)} {format_window(self.first, self.last)}"

    @property
    def span(self) -> Span:
        """From `first` to `last`."""
        return Span(self.first, self.last)

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
        return "leaves the place to loiter"

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return 1 - |position - centre| / radius, rounded at the centre."""
        return [-outside_disc(moment, self.centre, self.radius)]
