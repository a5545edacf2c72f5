"""Constant airspeed, steered by its turn rate, carried by wind or current."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_positive
from obsdesign.signals import Signal
from obsdesign.vehicles import _planar as planar
from obsdesign.vehicles.abstract import TURN_RATE, AbstractVehicle, Fields

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True)
class Dubins(AbstractVehicle):
    """A vehicle of constant speed that steers: a car that cannot reverse, an aircraft at one height.

    xdot = speed cos(heading) + wind_x, ydot = speed sin(heading) + wind_y, headingdot = turn_rate.
    States x, y [m] and heading [rad], input turn_rate [rad/s].
    Raises InputError for other values. Source: Brace and Morgansen, Sigma_D (eq. 6).
    """

    speed: float
    """Speed through air or water [m/s], > 0."""
    wind: planar.Wind | None = None
    """None, "constant" (states wind_x, wind_y [m/s]) or "unknown" (unknown inputs of those names)."""

    def __post_init__(self) -> None:
        require_positive("speed", self.speed)
        planar.require_wind(self.wind)

    @property
    def states(self) -> tuple[Signal, ...]:
        """x, y [m], heading [rad]; with a constant wind also wind_x, wind_y [m/s]."""
        return planar.planar_states(self.wind)

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """The turn rate [rad/s]."""
        return (TURN_RATE,)

    @property
    def disturbances(self) -> tuple[Signal, ...]:
        """(wind_x, wind_y) [m/s] where the wind is unknown, else nothing."""
        return planar.planar_disturbances(self.wind)

    def fields(self, x: ca.SX) -> Fields:
        """Return the drift speed (cos(heading), sin(heading), 0, ...) + wind, the turn's field e_3, and the unknown wind's e_1, e_2."""
        drift = self.speed * planar.forward_field(x) + planar.wind_drift(x, self.wind)
        return Fields(drift, (planar.turn_field(x),), planar.wind_fields(x, self.wind))
