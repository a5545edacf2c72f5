"""Passing by."""

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
class Via(AbstractConstraint):
    """The path passes a point: |position(t) - point| <= tolerance at one instant t from first to last.

    margin = 1 - |position - point| / tolerance, rounded within 0.001 tolerance of the point, where it has a derivative.
    Raises InputError for other values.
    """

    point: Point
    """Where the path is to pass (x, y) [m]."""
    tolerance: float
    """How near it has to come [m], > 0."""
    first: float = 0.0
    """The earliest instant that counts [s], >= 0."""
    last: float | None = None
    """The latest one [s], >= first; None = the end of the path."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", as_pair("via: point", self.point))
        object.__setattr__(self, "tolerance", as_size("via: tolerance", self.tolerance))
        first, last = as_window("via", self.first, self.last)
        object.__setattr__(self, "first", first)
        object.__setattr__(self, "last", last)

    def __str__(self) -> str:
        place = f"within {format_numbers(self.tolerance)} m of {format_numbers(*self.point)}"
        return f"Via: {place} once {format_window(self.first, self.last)}"

    @property
    def span(self) -> Span:
        """At one instant from `first` to `last`."""
        return Span(self.first, self.last, anywhere=True)

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
        return "misses a via point"

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return 1 - |position - point| / tolerance, rounded at the point."""
        return [-outside_disc(moment, self.point, self.tolerance)]
