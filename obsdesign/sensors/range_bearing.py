"""Distance and direction to a beacon, by one sensor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_positive
from obsdesign.sensors._beacon import AbstractDirectionSensor
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class RangeBearing(AbstractDirectionSensor):
    """A lidar's or camera's landmark: h = (|beacon - sensor|, atan2(beacon - sensor) - heading - mounting_angle) [m, rad].

    One sensor with two outputs, on and off and arriving together; sigma and sigma_per_metre are those of the distance.
    Raises InputError for values outside the ranges below.
    """

    bearing_sigma: float
    """Standard deviation of one sample of the direction [rad]; > 0."""
    name: str = "range_bearing"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(f"{self.name}: bearing_sigma", self.bearing_sigma)

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """A distance [m] and an angle [rad], wrapped."""
        return (Signal(f"{self.name}_distance", "m"), Signal(f"{self.name}_angle", "rad", is_angle=True))

    def spread(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return (sqrt(sigma^2 + (sigma_per_metre r)^2), bearing_sigma)."""
        import casadi as ca

        return ca.vertcat(self.spread_with(self.sigma, state), self.bearing_sigma)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return the distance, and atan2(beacon - sensor) - heading - mounting_angle."""
        return (self.distance(self.only_beacon, state), self.direction(state))
