"""Distance to the other robot."""

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
class PeerRange(AbstractOnboard):
    """Distance to the peer of `two_robots`: h = |(peer_x - x, peer_y - y)| [m]. Singular where the two are one."""

    name: str = "peer_range"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One distance [m]."""
        return (Signal(self.name, "m"),)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return the distance."""
        east, north = state["peer_x"] - state["x"], state["peer_y"] - state["y"]
        return ((east * east + north * north) ** 0.5,)
