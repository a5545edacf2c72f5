"""Direction to a beacon, seen from the vehicle."""

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
class Bearing(AbstractSensor):
    """h = atan2(beacon - position) - heading, counter-clockwise, wrapped; sigma [rad], beacon (x, y) [m].

    Source: Brace and Morgansen, Table I, which has the direction from beacon to vehicle: the same information.
    """

    beacon: Point
    sigma: float
    rate: float | None = None
    name: str = "bearing"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "beacon", as_pair(f"{self.name}: beacon", self.beacon))

    @property
    def outputs(self) -> tuple[Signal, ...]:
        return (Signal(self.name, "rad", is_angle=True),)

    @property
    def landmark(self) -> Point:
        return self.beacon

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        import casadi as ca

        east, north = self.beacon[0] - state["x"], self.beacon[1] - state["y"]
        return (ca.atan2(north, east) - state["heading"],)
