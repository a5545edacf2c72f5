"""How the vehicle's velocity changes, as felt on board."""

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
class Accelerometer(AbstractOnboard):
    """Accelerations of a level vehicle that drives along its nose, forward and to the left: h = (dv/dt, v dheading/dt) [m/s^2].

    v is the state speed; an acceleration and a turn rate that are inputs stand in the outputs. Wind that does not change adds nothing.
    """

    name: str = "accelerometer"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """Two accelerations [m/s^2]."""
        return (Signal(f"{self.name}_forward", "m/s^2"), Signal(f"{self.name}_left", "m/s^2"))

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return (dv/dt, v dheading/dt)."""
        return (state["speed_rate"], state["speed"] * state["heading_rate"])
