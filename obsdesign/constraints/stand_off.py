"""Keeping away from landmarks, whose information grows without limit as one comes near."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from obsdesign.checks import require_positive
from obsdesign.constraints.abstract import AbstractConstraint, Coordinate, squared_distance
from obsdesign.signals import Point


@dataclass(frozen=True)
class StandOff(AbstractConstraint):
    """|position(t_k) - landmark| >= distance for every landmark that a sensor looks at; distance [m] > 0."""

    distance: float

    def __post_init__(self) -> None:
        require_positive("stand_off: distance", self.distance)

    def at_nodes(self, x: Coordinate, y: Coordinate, landmarks: Sequence[Point]) -> list[Coordinate]:
        return [squared_distance(x, y, point) / self.distance**2 - 1 for point in landmarks]

    def at_end(self, x: Coordinate, y: Coordinate) -> list[Coordinate]:
        return []
