"""Speed and turn rate as inputs, carried by wind or current."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.signals import Signal
from obsdesign.vehicles import _planar as planar
from obsdesign.vehicles.abstract import SPEED, TURN_RATE, AbstractVehicle, Fields

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True)
class Unicycle(AbstractVehicle):
    """A vehicle that drives along its nose at a speed that is steered too.

    xdot = speed cos(heading) + wind_x, ydot = speed sin(heading) + wind_y, headingdot = turn_rate.
    States x, y [m] and heading [rad], inputs speed [m/s] and turn_rate [rad/s].
    Raises InputError for other values. Source: Brace and Morgansen, Sigma_U (eq. 5).
    """

    wind: planar.Wind | None = None
    """None, "constant" (states wind_x, wind_y [m/s]) or "unknown" (unknown inputs of those names)."""

    def __post_init__(self) -> None:
        planar.require_wind(self.wind)

    @property
    def states(self) -> tuple[Signal, ...]:
        """x, y [m], heading [rad]; with a constant wind also wind_x, wind_y [m/s]."""
        return planar.planar_states(self.wind)

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """speed [m/s] and turn_rate [rad/s]."""
        return (SPEED, TURN_RATE)

    @property
    def disturbances(self) -> tuple[Signal, ...]:
        """(wind_x, wind_y) [m/s] where the wind is unknown, else nothing."""
        return planar.planar_disturbances(self.wind)

    def fields(self, x: ca.SX) -> Fields:
        """Return the wind as drift, the speed's field (cos(heading), sin(heading), 0, ...), the turn's and the unknown wind's."""
        return Fields(planar.wind_drift(x, self.wind), (planar.forward_field(x), planar.turn_field(x)), planar.wind_fields(x, self.wind))
