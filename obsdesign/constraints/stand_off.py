"""Keeping away from landmarks, whose information grows without limit as one comes near."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.constraints._given import LENGTH, as_landmarks, as_size, format_numbers, format_points
from obsdesign.constraints._shapes import outside_disc
from obsdesign.constraints.abstract import ALWAYS, AbstractConstraint, Coordinate, Moment, Span
from obsdesign.signals import Point


@validate_arguments
@dataclass(frozen=True)
class StandOff(AbstractConstraint):
    """The vehicle keeps its distance from every landmark: |position - landmark| >= distance.

    One margin per landmark, |position - landmark| / distance - 1, rounded within 0.001 distance of the landmark, where it has a
    derivative. Raises InputError for other values.
    """

    distance: float
    """The least distance [m], > 0."""
    landmarks: tuple[Point, ...] | None = None
    """Points (k, 2) [m]; None = those that the sensors look at."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "distance", as_size("stand_off: distance", self.distance))
        object.__setattr__(self, "landmarks", as_landmarks("stand_off: landmarks", self.landmarks))

    def __str__(self) -> str:
        which = "the landmarks" if self.landmarks is None else format_points(self.landmarks)
        return f"StandOff: at least {format_numbers(self.distance)} m from {which}"

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
        """The smallest distance [m]."""
        return self.distance, LENGTH

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return "comes too near a beacon"

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return |position - landmark| / distance - 1 for every landmark, rounded at it."""
        points = moment.landmarks if self.landmarks is None else self.landmarks
        return [outside_disc(moment, point, self.distance) for point in points]
