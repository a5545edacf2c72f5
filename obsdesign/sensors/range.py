"""Distance to a beacon."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.checks import as_pair
from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.signals import Point, Signal

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True)
class Range(AbstractSensor):
    """h = |beacon - position|; sigma [m], beacon (x, y) [m]. Source: Brace and Morgansen, Table I."""

    beacon: Point
    sigma: float
    rate: float | None = None
    name: str = "range"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "beacon", as_pair(f"{self.name}: beacon", self.beacon))

    @property
    def outputs(self) -> tuple[Signal, ...]:
        return (Signal(self.name, "m"),)

    @property
    def landmark(self) -> Point:
        return self.beacon

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        east, north = self.beacon[0] - state["x"], self.beacon[1] - state["y"]
        return ((east * east + north * north) ** 0.5,)
