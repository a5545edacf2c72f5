"""A unicycle whose place is told by its distance and direction from a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.signals import Signal
from obsdesign.vehicles.abstract import HEADING, SPEED, TURN_RATE, AbstractVehicle, Fields

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True)
class PolarUnicycle(AbstractVehicle):
    """A unicycle in polar coordinates about (0, 0): r' = v cos(h - d), d' = v sin(h - d) / r, h' = turn_rate.

    States distance r [m], direction d and heading h [rad], counter-clockwise from the x axis; inputs speed v [m/s], turn_rate [rad/s].
    Sensors read x = r cos d and y = r sin d as of any planar vehicle. Singular at r = 0.
    Source: Martinelli, SIAM 2018, section 4.
    """

    @property
    def states(self) -> tuple[Signal, ...]:
        """distance [m], direction, heading [rad]."""
        return (Signal("distance", "m"), Signal("direction", "rad", is_angle=True), HEADING)

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """speed [m/s] and turn_rate [rad/s]."""
        return (SPEED, TURN_RATE)

    @property
    def disturbances(self) -> tuple[Signal, ...]:
        """None."""
        return ()

    def fields(self, x: ca.SX) -> Fields:
        """Return the fields of speed and turn rate, and where the vehicle is in the plane."""
        import casadi as ca

        r, direction, heading = x[0], x[1], x[2]
        forward = ca.vertcat(ca.cos(heading - direction), ca.sin(heading - direction) / r, 0)
        place = {"x": r * ca.cos(direction), "y": r * ca.sin(direction)}
        return Fields(ca.SX.zeros(3), (forward, ca.SX([0.0, 0.0, 1.0])), derived=place)
