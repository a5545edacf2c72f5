"""How long a path takes."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.costs.abstract import AbstractCost
from obsdesign.moment import Coordinate, Moment


@dataclass(frozen=True)
class FlightTime(AbstractCost):
    """How long the path takes: the integral of 1 over time, the duration [s]."""

    def __str__(self) -> str:
        return "flight time"

    @property
    def unit(self) -> str:
        """Seconds."""
        return "s"

    def rate(self, moment: Moment) -> Coordinate:
        """Return 1."""
        # one for every instant: an array of ones where the states are arrays
        return 1.0 + 0.0 * next(iter(moment.state.values()), 0.0)
