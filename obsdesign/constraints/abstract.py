"""What a constraint is: numbers that must not be negative."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

from obsdesign.signals import Point

# coordinates [m] of one or more nodes: floats, NumPy arrays and SX columns alike, so one definition serves check and design
Coordinate = Any


class AbstractConstraint(ABC):
    """A limit on where a path may go. Leaves are final frozen dataclasses, one file each.

    Margins are >= 0 where the constraint holds, without unit and of order 1, elementwise in x and y.
    """

    @abstractmethod
    def at_nodes(self, x: Coordinate, y: Coordinate, landmarks: Sequence[Point]) -> list[Coordinate]:
        """Return margins that must hold at every node (x, y) of the path."""

    @abstractmethod
    def at_end(self, x: Coordinate, y: Coordinate) -> list[Coordinate]:
        """Return margins that must hold at the last node (x, y)."""


def squared_distance(x: Coordinate, y: Coordinate, point: Point) -> Coordinate:
    """(x - px)^2 + (y - py)^2 [m^2]."""
    return (x - point[0]) * (x - point[0]) + (y - point[1]) * (y - point[1])
