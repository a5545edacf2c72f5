"""Depth below the surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.sensors._onboard import AbstractOnboard
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class Depth(AbstractOnboard):
    """Pressure sensor: h = depth [m] below the surface, of a vehicle that has that state."""

    name: str = "depth_sensor"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One depth [m]."""
        return (Signal(self.name, "m"),)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return the depth."""
        return (state["depth"],)
