"""Direction to a beacon, seen from the vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_finite
from obsdesign.sensors._beacon import AbstractBeaconSensor
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class Bearing(AbstractBeaconSensor):
    """Direction to a beacon, off the sensor's nose: h = atan2(beacon - sensor) - heading - mounting_angle [rad], wrapped.

    Angles count counter-clockwise.
    Source: Brace and Morgansen, Table I, which has the direction from beacon to vehicle: the same information.
    """

    mounting_angle: float = 0.0
    """How far the sensor's nose is turned from the vehicle's [rad], counter-clockwise."""
    name: str = "bearing"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(f"{self.name}: mounting_angle", self.mounting_angle)

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One angle [rad], wrapped."""
        return (Signal(self.name, "rad", is_angle=True),)

    @property
    def nose(self) -> float:
        """The mounting angle."""
        return self.mounting_angle

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return atan2(beacon - sensor) - heading - mounting_angle."""
        direction = self.direction(state)
        return (direction - self.mounting_angle if self.mounting_angle else direction,)

    def spread(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return sqrt(sigma^2 + (sigma_per_metre r)^2)."""
        return self.spread_with(self.sigma, state)
