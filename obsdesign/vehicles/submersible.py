"""A vehicle under water: it dives, and is carried by the current."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.signals import Signal
from obsdesign.vehicles import _planar as planar
from obsdesign.vehicles.abstract import HEADING, SPEED, TURN_RATE, WIND, AbstractVehicle, Fields, X, Y

if TYPE_CHECKING:
    import casadi as ca

_DEPTH, _DIVE_RATE = Signal("depth", "m"), Signal("dive_rate", "m/s")


@validate_arguments
@dataclass(frozen=True)
class Submersible(AbstractVehicle):
    """A vehicle that drives along its nose, turns, and dives.

    xdot = speed cos(heading) + wind_x, ydot = speed sin(heading) + wind_y, headingdot = turn_rate, depthdot = dive_rate: the wind is
    the current, and speed the horizontal one through the water. Distances to beacons are those in space, a beacon's height counting
    from the surface.
    States x, y [m], heading [rad], depth [m] > 0 below the surface; inputs speed, turn_rate [rad/s] and dive_rate [m/s].
    Raises InputError for other values.
    """

    wind: planar.Wind | None = None
    """None, "constant" (states wind_x, wind_y [m/s]) or "unknown" (unknown inputs of those names)."""

    def __post_init__(self) -> None:
        planar.require_wind(self.wind)

    @property
    def states(self) -> tuple[Signal, ...]:
        """x, y [m], heading [rad], depth [m]; with a constant current also wind_x, wind_y [m/s]."""
        return (X, Y, HEADING, _DEPTH) + (WIND if self.wind == "constant" else ())

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """speed [m/s], turn_rate [rad/s] and dive_rate [m/s]."""
        return (SPEED, TURN_RATE, _DIVE_RATE)

    @property
    def disturbances(self) -> tuple[Signal, ...]:
        """(wind_x, wind_y) [m/s] where the wind is unknown, else nothing."""
        return planar.planar_disturbances(self.wind)

    def fields(self, x: ca.SX) -> Fields:
        """Return the current as drift, the fields of speed, (cos(heading), sin(heading), 0, ...), turn, dive, and unknown current."""
        motions = (planar.forward_field(x), planar.turn_field(x), planar.unit_field(x, 3))
        return Fields(planar.wind_drift(x, self.wind), motions, planar.wind_fields(x, self.wind))
