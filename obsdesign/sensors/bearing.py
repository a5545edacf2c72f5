"""Direction to a beacon, seen from the vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.sensors._beacon import AbstractBeaconSensor
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class Bearing(AbstractBeaconSensor):
    """Direction to a beacon, off the nose: h = atan2(beacon - position) - heading [rad], counter-clockwise, wrapped.

    Source: Brace and Morgansen, Table I, which has the direction from beacon to vehicle: the same information.
    """

    name: str = "bearing"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One angle [rad], wrapped."""
        return (Signal(self.name, "rad", is_angle=True),)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return atan2(beacon - position) - heading."""
        import casadi as ca

        east, north = self.offset(state)
        return (ca.atan2(north, east) - state["heading"],)
