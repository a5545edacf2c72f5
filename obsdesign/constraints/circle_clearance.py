"""Not staying on the circle through three landmarks, on which their bearings hide where one is."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.constraints._given import LENGTH, as_landmarks, as_size, format_numbers, format_points
from obsdesign.constraints._shapes import smooth_excess
from obsdesign.constraints.abstract import ALWAYS, AbstractConstraint, Coordinate, Moment, Span
from obsdesign.geometry import circle_through
from obsdesign.signals import Point


@validate_arguments
@dataclass(frozen=True)
class CircleClearance(AbstractConstraint):
    """The path neither follows nor stands on the circle through three landmarks, where bearings with unknown inputs tell too little.

    sqrt(f^2 + (time_scale df/dt)^2) >= clearance, f = |position - c| - r, c and r of the circle. It may be crossed, at a radial speed of
    clearance / time_scale or more. Rounded at c and where f = df/dt = 0, where it has derivatives; at the latter they are 0: a solver that
    starts on a path along the circle gets no hint to which side to leave it.
    Raises InputError for other values and for points on one line. Source: the singular set of Belo, Salaris and Bicchi 2010, section IV-B.
    """

    clearance: float
    """The least of the left side [m], > 0."""
    time_scale: float
    """How much a radial speed counts as distance [s], > 0."""
    landmarks: tuple[Point, ...] | None = None
    """Three points (x, y) [m]; None = those that the sensors look at."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "clearance", as_size("circle_clearance: clearance", self.clearance))
        object.__setattr__(self, "time_scale", as_size("circle_clearance: time_scale", self.time_scale))
        object.__setattr__(self, "landmarks", as_landmarks("circle_clearance: landmarks", self.landmarks))
        if self.landmarks is not None:
            circle_through(self.landmarks)

    def __str__(self) -> str:
        which = "the landmarks" if self.landmarks is None else format_points(self.landmarks)
        moving = f"moving from it by that much in {format_numbers(self.time_scale)} s"
        return f"CircleClearance: at least {format_numbers(self.clearance)} m from the circle through {which}, or {moving}"

    @property
    def span(self) -> Span:
        """At every instant of the path."""
        return ALWAYS

    @property
    def states(self) -> tuple[str, ...]:
        """The position, (x, y); its rates come with it."""
        return ("x", "y")

    @property
    def size(self) -> tuple[float, str]:
        """The clearance [m]."""
        return self.clearance, LENGTH

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return "stays too near the beacons' circle"

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return (sqrt(f^2 + (time_scale df/dt)^2) - clearance) / clearance, rounded where f = df/dt = 0."""
        (x, y), radius = circle_through(moment.landmarks if self.landmarks is None else self.landmarks)
        east, north = moment.state["x"] - x, moment.state["y"] - y
        off = smooth_excess(east * east + north * north, radius)
        leaving = self.time_scale * (east * moment.rate["x"] + north * moment.rate["y"]) / (radius + off)
        return [smooth_excess(off * off + leaving * leaving, self.clearance) / self.clearance]
