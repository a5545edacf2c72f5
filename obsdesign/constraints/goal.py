"""Arriving."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from obsdesign.checks import as_pair, require_positive
from obsdesign.constraints.abstract import AbstractConstraint, Coordinate, squared_distance
from obsdesign.signals import Point


@dataclass(frozen=True)
class Goal(AbstractConstraint):
    """|position(t_N) - point| <= tolerance; point (x, y) [m], tolerance [m] > 0."""

    point: Point
    tolerance: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", as_pair("goal: point", self.point))
        require_positive("goal: tolerance", self.tolerance)

    def at_nodes(self, x: Coordinate, y: Coordinate, landmarks: Sequence[Point]) -> list[Coordinate]:
        return []

    def at_end(self, x: Coordinate, y: Coordinate) -> list[Coordinate]:
        return [1 - squared_distance(x, y, self.point) / self.tolerance**2]
