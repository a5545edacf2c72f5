"""Velocity over ground along the axes of the body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_finite
from obsdesign.sensors._onboard import AbstractOnboard
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class VelocityLog(AbstractOnboard):
    """Doppler velocity log of a vessel: h = R(heading + mounting_angle)' (xdot, ydot) [m/s], forward and to the left, over ground.

    No unknown input may have a part in that velocity: no current or a constant one, a speed that is known, constant or a state.
    Raises InputError for values outside the ranges below.
    """

    mounting_angle: float = field(default=0.0, kw_only=True)
    """How far the sensor's axis is turned from the vehicle's [rad], counter-clockwise."""
    name: str = "velocity_log"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(f"{self.name}: mounting_angle", self.mounting_angle)

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """Two speeds [m/s]."""
        return (Signal(f"{self.name}_forward", "m/s"), Signal(f"{self.name}_left", "m/s"))

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return the velocity over ground along the sensor's axis and to its left."""
        import casadi as ca

        axis = state["heading"] + self.mounting_angle if self.mounting_angle else state["heading"]
        cosine, sine = ca.cos(axis), ca.sin(axis)
        east, north = state["x_rate"], state["y_rate"]
        return (east * cosine + north * sine, north * cosine - east * sine)
