"""How fast the distance to a beacon changes."""

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
class Doppler(AbstractSingleBeacon):
    """Doppler shift of a beacon's signal, as a speed: h = d/dt |beacon - sensor| = -(beacon - sensor)'v / r [m/s], > 0 when it recedes.

    No unknown input may have a part in the velocity v over ground: no wind or a constant one, a speed that is known, constant or a state.
    What a sonar log measures, the velocity along the axes of the body, is `VelocityLog`.
    Singular at the beacon; says nothing of the state where the vehicle stands still but for its speed.
    """

    name: str = "doppler"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One speed [m/s]."""
        return (Signal(self.name, "m/s"),)

    @property
    def nose(self) -> float:
        """0: it looks ahead."""
        return 0.0

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return -(beacon - sensor)'v / r."""
        return (self.half_square_rate(self.only_beacon, state) / self.distance(self.only_beacon, state),)

    def spread(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return sqrt(sigma^2 + (sigma_per_metre r)^2)."""
        return self.spread_with(self.sigma, state)
