"""Keeping to one side of a line."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.constraints.abstract import ALWAYS, AbstractConstraint, Coordinate, Moment, Span
from obsdesign.signals import Point


@dataclass(frozen=True)
class HalfPlane(AbstractConstraint):
    """normal . position <= reach, |normal| = 1: one margin, (reach - normal . position) / size."""

    normal: Point
    """Unit vector (2,) across the line, away from where the vehicle stays."""
    reach: float
    """Distance of the line from the origin [m]."""

    def __str__(self) -> str:
        return f"HalfPlane: at most {self.reach:g} m along {self.normal}"

    @property
    def span(self) -> Span:
        return ALWAYS

    @property
    def states(self) -> tuple[str, ...]:
        return ("x", "y")

    @property
    def size(self) -> tuple[float, str]:
        return (5.0, "m")

    @property
    def breach(self) -> str:
        return "crosses the line"

    def margins(self, moment: Moment) -> list[Coordinate]:
        along = self.normal[0] * moment.state["x"] + self.normal[1] * moment.state["y"]
        return [(self.reach - along) / self.size[0]]
