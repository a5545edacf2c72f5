"""Direction to the other robot."""

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
class PeerBearing(AbstractOnboard):
    """Direction to the peer of `two_robots`, off the own nose: h = atan2(peer_y - y, peer_x - x) - heading [rad], wrapped."""

    name: str = "peer_bearing"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One angle [rad], wrapped."""
        return (Signal(self.name, "rad", is_angle=True),)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return the direction off the nose."""
        import casadi as ca

        return (ca.atan2(state["peer_y"] - state["y"], state["peer_x"] - state["x"]) - state["heading"],)
