"""How fast the vehicle turns."""

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
class Gyroscope(AbstractOnboard):
    """Turn rate: h = dheading/dt [rad/s], counter-clockwise; with `bias` as a state, more than that.

    Of a vehicle whose turn rate is known it tells nothing but its own scale and bias; what is unknown must have no part in it.
    """

    name: str = "gyroscope"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One rate [rad/s]."""
        return (Signal(self.name, "rad/s"),)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return how fast the heading changes."""
        return (state["heading_rate"],)
