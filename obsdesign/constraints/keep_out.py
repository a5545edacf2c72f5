"""Staying out of a circle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from obsdesign.checks import as_pair, require_positive
from obsdesign.constraints.abstract import AbstractConstraint, Coordinate, squared_distance
from obsdesign.signals import Point


@dataclass(frozen=True)
class KeepOut(AbstractConstraint):
    """|position(t_k) - centre| >= radius at every node; centre (x, y) [m], radius [m] > 0."""

    centre: Point
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", as_pair("keep_out: centre", self.centre))
        require_positive("keep_out: radius", self.radius)

    def at_nodes(self, x: Coordinate, y: Coordinate, landmarks: Sequence[Point]) -> list[Coordinate]:
        return [squared_distance(x, y, self.centre) / self.radius**2 - 1]

    def at_end(self, x: Coordinate, y: Coordinate) -> list[Coordinate]:
        return []
