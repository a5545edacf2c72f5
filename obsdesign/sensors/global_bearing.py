"""Direction to a beacon on the map, seen from the vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.sensors._beacon import AbstractSingleBeacon
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class GlobalBearing(AbstractSingleBeacon):
    """Direction to a beacon against the map's x axis: h = atan2(beacon - sensor) [rad], counter-clockwise, wrapped.

    What a bearing and a compass on one mast tell together, or a direction finder at the beacon, which sees the same line from its other
    end. The field of view is about the vehicle's nose.
    """

    name: str = "global_bearing"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One angle [rad], wrapped."""
        return (Signal(self.name, "rad", is_angle=True),)

    @property
    def nose(self) -> float:
        """The vehicle's own."""
        return 0.0

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return atan2(beacon - sensor)."""
        import casadi as ca

        east, north = self.offset(self.beacon, state)
        return (ca.atan2(north, east),)

    def spread(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return sqrt(sigma^2 + (sigma_per_metre r)^2)."""
        return self.spread_with(self.sigma, state)
