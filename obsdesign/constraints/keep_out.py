"""Staying out of a circle."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_pair
from obsdesign.constraints._given import LENGTH, as_size, spelled
from obsdesign.constraints._shapes import outside_disc
from obsdesign.constraints.abstract import ALWAYS, AbstractConstraint, Coordinate, Moment, Span
from obsdesign.signals import Point


@validate_arguments
@dataclass(frozen=True)
class KeepOut(AbstractConstraint):
    """|position - centre| >= radius; centre (x, y) [m], radius [m] > 0. Raises InputError for other values.

    margin = |position - centre| / radius - 1, rounded within 0.001 radius of the centre, where it has a derivative.
    """

    centre: Point
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", as_pair("keep_out: centre", self.centre))
        object.__setattr__(self, "radius", as_size("keep_out: radius", self.radius))

    def __str__(self) -> str:
        return f"KeepOut: at least {spelled(self.radius)} m from {spelled(*self.centre)}"

    @property
    def span(self) -> Span:
        return ALWAYS

    @property
    def states(self) -> tuple[str, ...]:
        return ("x", "y")

    @property
    def size(self) -> tuple[float, str]:
        return self.radius, LENGTH

    def margins(self, moment: Moment) -> list[Coordinate]:
        return [outside_disc(moment, self.centre, self.radius)]
