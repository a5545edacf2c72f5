"""Direction to a beacon, seen from the vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.sensors._beacon import AbstractDirectionSensor
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class Bearing(AbstractDirectionSensor):
    """Direction to a beacon, off the sensor's nose: h = atan2(beacon - sensor) - heading - mounting_angle [rad], wrapped.

    Angles count counter-clockwise.
    Source: Brace and Morgansen, Table I, which has the direction from beacon to vehicle: the same information.
    """

    name: str = "bearing"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One angle [rad], wrapped."""
        return (Signal(self.name, "rad", is_angle=True),)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return atan2(beacon - sensor) - heading - mounting_angle."""
        return (self.direction(state),)

    def spread(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return sqrt(sigma^2 + (sigma_per_metre r)^2)."""
        return self.spread_with(self.sigma, state)
