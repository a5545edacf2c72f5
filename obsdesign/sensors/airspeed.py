"""Speed through the air or the water."""

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
class Airspeed(AbstractOnboard):
    """Pitot tube or paddle wheel: h = |(xdot - wind_x, ydot - wind_y)| [m/s], the speed through air or water.

    The wind has to be a state where there is one. A vehicle whose speed is known or constant tells nothing by it but the sensor's own
    scale and bias.
    Singular at zero speed.
    """

    name: str = "airspeed"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One speed [m/s]."""
        return (Signal(self.name, "m/s"),)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return |(xdot - wind_x, ydot - wind_y)|."""
        east, north = (state[f"{axis}_rate"] - state.get(f"wind_{axis}", 0) for axis in ("x", "y"))
        return ((east**2 + north**2) ** 0.5,)
