"""Pointing somewhere on a leg."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

from obsdesign.arguments import validate_arguments
from obsdesign.constraints._given import ANGLE, as_angle, as_window, format_numbers, format_window
from obsdesign.constraints._shapes import within_angle
from obsdesign.constraints.abstract import AbstractConstraint, Coordinate, Moment, Span
from obsdesign.errors import InputError


@validate_arguments
@dataclass(frozen=True)
class HeadingSector(AbstractConstraint):
    """The vehicle looks into a sector for a stretch of time: low <= heading(t) <= high, to whole turns.

    The sector runs counter-clockwise from low to high: (6.0, 0.5) spans 0.78 rad across the direction of x.
    With T half the width, a the angle from the middle and c(a) = 2 |sin(a / 2)|: margin = (c(T) - c(a)) / (T cos(T / 2)), whose slope
    at the edges is 1 / T; rounded within 0.001 T of the middle, where it has a derivative. Raises InputError for other values.
    """

    low: float
    """Where the sector begins [rad]."""
    high: float
    """Where it ends [rad], less than a turn further."""
    first: float = 0.0
    """From when on it counts [s], >= 0."""
    last: float | None = None
    """Until when it counts [s], >= first; None = to the end of the path."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "low", as_angle("heading_sector: low", self.low))
        object.__setattr__(self, "high", as_angle("heading_sector: high", self.high))
        first, last = as_window("heading_sector", self.first, self.last)
        object.__setattr__(self, "first", first)
        object.__setattr__(self, "last", last)
        if abs(self.high - self.low) >= 2 * pi or not 0 < self.width < 2 * pi:
            raise InputError(
                f"heading_sector: high is {self.high!r}: must differ from low, {self.low!r}, by more than 0 and less than 2 pi rad"
            )

    def __str__(self) -> str:
        sector = f"heading from {format_numbers(self.low)} counter-clockwise to {format_numbers(self.high)} rad"
        return f"HeadingSector: {sector} {format_window(self.first, self.last)}"

    @property
    def width(self) -> float:
        """Counter-clockwise from low to high [rad], in (0, 2 pi)."""
        return (self.high - self.low) % (2 * pi)

    @property
    def span(self) -> Span:
        """From `first` to `last`."""
        return Span(self.first, self.last)

    @property
    def states(self) -> tuple[str, ...]:
        """The heading."""
        return ("heading",)

    @property
    def size(self) -> tuple[float, str]:
        """Half the sector's width [rad]."""
        return self.width / 2, ANGLE

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return "heads out of its sector"

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return (c(T) - c(a)) / (T cos(T / 2)), with T half the width and a the angle from the sector's middle."""
        half = self.width / 2
        return [within_angle(moment.state["heading"], self.low + half, half)]
