"""A camera that sees a point in space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_finite
from obsdesign.quaternions import conjugate, rotate
from obsdesign.sensors._onboard import AbstractOnboard
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class Camera(AbstractOnboard):
    """Where a point stands in the picture: h = (F_x / F_z, F_y / F_z), F = q* (r - feature) q, seen along the vehicle's z axis.

    For a vehicle in space, with states x, y, z and q_t, q_x, q_y, q_z. The point and its mirror image behind the camera are alike.
    Singular where F_z = 0. Source: Martinelli, IROS 2017, eq. 7.
    """

    feature: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the point stands (x, y, z) [m]."""
    name: str = "camera"

    def __post_init__(self) -> None:
        super().__post_init__()
        for value in self.feature:
            require_finite(f"{self.name}: feature", value)

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """Two tangents."""
        return (Signal(f"{self.name}_u", ""), Signal(f"{self.name}_v", ""))

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return (F_x / F_z, F_y / F_z)."""
        import casadi as ca

        offset = ca.vertcat(*(state[name] - value for name, value in zip("xyz", self.feature, strict=True)))
        attitude = ca.vertcat(*(state[name] for name in ("q_t", "q_x", "q_y", "q_z")))
        seen = rotate(conjugate(attitude), offset)
        return (seen[0] / seen[2], seen[1] / seen[2])
