"""Course over ground."""

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
class Course(AbstractOnboard):
    """Satellite course: h = atan2(ydot, xdot) [rad], the direction of the velocity over ground, wind or current in it; wrapped.

    No unknown input may have a part in that velocity: no wind or a constant one, a speed that is known, constant or a state.
    Singular where the vehicle stands still over ground.
    """

    name: str = "course"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One angle [rad], wrapped."""
        return (Signal(self.name, "rad", is_angle=True),)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return atan2(ydot, xdot)."""
        import casadi as ca

        return (ca.atan2(state["y_rate"], state["x_rate"]),)
