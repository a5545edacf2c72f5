"""Distance to a beacon."""

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
class Range(AbstractBeaconSensor):
    """Distance to a beacon: h = |beacon - position| [m].

    Source: Brace and Morgansen, Table I.
    """

    name: str = "range"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One distance [m]."""
        return (Signal(self.name, "m"),)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return |beacon - position|."""
        return (self.distance(state),)
