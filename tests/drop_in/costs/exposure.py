"""How long one is seen, and how well."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.costs.abstract import AbstractCost
from obsdesign.moment import Coordinate, Moment
from obsdesign.signals import Point


@dataclass(frozen=True)
class Exposure(AbstractCost):
    """The integral over time of 1 / (1 + |position - radar|^2 / reach^2) [s]."""

    radar: Point
    """Where the radar stands (2,) [m]."""
    reach: float
    """Distance at which it sees half [m]."""

    def __str__(self) -> str:
        return "exposure"

    @property
    def unit(self) -> str:
        return "s"

    def rate(self, moment: Moment) -> Coordinate:
        east, north = moment.state["x"] - self.radar[0], moment.state["y"] - self.radar[1]
        return 1 / (1 + (east * east + north * north) / self.reach**2)
