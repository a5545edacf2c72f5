"""How long a path is."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.costs.abstract import AbstractCost
from obsdesign.moment import Coordinate, Moment

_SOFT = 1e-6  # [m/s] added in the square: at 1 mm/s a length is too long by 5e-7 of it; larger is smoother at rest, and less exact


@dataclass(frozen=True)
class PathLength(AbstractCost):
    """How long the path is over ground: the integral over time of sqrt((dx/dt)^2 + (dy/dt)^2 + s^2) [m].

    s = 1e-6 m/s gives it a derivative at rest; it is too long by at most s per second, at 1 mm/s by 5e-7 of the length.
    """

    def __str__(self) -> str:
        return "path length"

    @property
    def unit(self) -> str:
        """Metres."""
        return "m"

    def rate(self, moment: Moment) -> Coordinate:
        """Return sqrt((dx/dt)^2 + (dy/dt)^2 + s^2) [m/s]."""
        east, north = moment.rate["x"], moment.rate["y"]
        return (east * east + north * north + _SOFT**2) ** 0.5
