"""Acceleration and turn rate as inputs, the speed a state, carried by wind or current."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.signals import Signal
from obsdesign.vehicles import _planar as planar
from obsdesign.vehicles.abstract import HEADING, SPEED, TURN_RATE, WIND, AbstractVehicle, Fields, X, Y

if TYPE_CHECKING:
    import casadi as ca

_ACCELERATION = Signal("acceleration", "m/s^2")


@validate_arguments
@dataclass(frozen=True)
class SecondOrderUnicycle(AbstractVehicle):
    """A vehicle that drives along its nose at a speed that nobody knows exactly, as its acceleration is what is steered.

    xdot = speed cos(heading) + wind_x, ydot = speed sin(heading) + wind_y, headingdot = turn_rate, speeddot = acceleration.
    States x, y [m], heading [rad] and speed [m/s], through air or water; inputs acceleration [m/s^2] and turn_rate [rad/s].
    Raises InputError for other values.
    """

    wind: planar.Wind | None = None
    """None, "constant" (states wind_x, wind_y [m/s]) or "unknown" (unknown inputs of those names)."""

    def __post_init__(self) -> None:
        planar.require_wind(self.wind)

    @property
    def states(self) -> tuple[Signal, ...]:
        """x, y [m], heading [rad], speed [m/s]; with a constant wind also wind_x, wind_y [m/s]."""
        return (X, Y, HEADING, SPEED) + (WIND if self.wind == "constant" else ())

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """acceleration [m/s^2] and turn_rate [rad/s]."""
        return (_ACCELERATION, TURN_RATE)

    @property
    def disturbances(self) -> tuple[Signal, ...]:
        """(wind_x, wind_y) [m/s] where the wind is unknown, else nothing."""
        return planar.planar_disturbances(self.wind)

    def fields(self, x: ca.SX) -> Fields:
        """Return the drift speed (cos(heading), sin(heading), 0, ...) + wind, the inputs' e_4 and e_3, and the unknown wind's e_1, e_2."""
        drift = x[3] * planar.forward_field(x) + planar.wind_drift(x, self.wind)
        return Fields(drift, (planar.unit_field(x, 3), planar.turn_field(x)), planar.wind_fields(x, self.wind))
