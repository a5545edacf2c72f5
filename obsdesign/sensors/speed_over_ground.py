"""Speed over ground."""

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
class SpeedOverGround(AbstractOnboard):
    """Satellite speed: h = |(xdot, ydot)| [m/s], over ground, wind or current in it.

    No unknown input may have a part in that velocity: no wind or a constant one, a speed that is known, constant or a state.
    Singular where the vehicle stands still over ground.
    """

    name: str = "speed_over_ground"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One speed [m/s]."""
        return (Signal(self.name, "m/s"),)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return |(xdot, ydot)|."""
        return ((state["x_rate"] ** 2 + state["y_rate"] ** 2) ** 0.5,)
