"""Flight in space, carried by wind along a direction that is known, or along any."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_finite
from obsdesign.errors import InputError
from obsdesign.quaternions import axis_columns, turn_columns
from obsdesign.signals import Signal
from obsdesign.vehicles import _attitude as attitude
from obsdesign.vehicles._planar import Wind, require_wind
from obsdesign.vehicles.abstract import AbstractVehicle, Fields

if TYPE_CHECKING:
    import casadi as ca

_AIRSPEED = (Signal("airspeed_x", "m/s"), Signal("airspeed_y", "m/s"), Signal("airspeed_z", "m/s"))
_ALONG = (Signal("wind", "m/s"),)
_ANY = (Signal("wind_x", "m/s"), Signal("wind_y", "m/s"), Signal("wind_z", "m/s"))


@validate_arguments
@dataclass(frozen=True)
class Aerial3D(AbstractVehicle):
    """A vehicle in space that knows how fast it turns and flies through the air, in its own axes, but not what the air does.

    rdot = q V q* + w d, qdot = q Omega / 2, r = (x, y, z) [m] in the map, q the quaternion from the vehicle's axes to the map's.
    Inputs roll_rate, pitch_rate, yaw_rate [rad/s] are Omega, airspeed_x, airspeed_y, airspeed_z [m/s] are V. The norm of q stays what
    it is; that it is 1 is what the sensor `quaternion_norm` says. Raises InputError for other values.
    Source: Martinelli, IROS 2017, eq. 4-6.
    """

    wind: Wind | None = None
    """None, "constant" (a state for it) or "unknown" (an unknown input): `wind` along the direction, or wind_x, wind_y, wind_z."""
    direction: tuple[float, float, float] | None = (0.0, 0.0, 1.0)
    """Which way the wind blows in the map, of any length but 0; None = any way."""

    def __post_init__(self) -> None:
        require_wind(self.wind)
        if self.direction is not None:
            for value in self.direction:
                require_finite("direction", value)
            if not any(self.direction):
                raise InputError("direction is (0, 0, 0): must point somewhere, or be None, any way")

    @property
    def states(self) -> tuple[Signal, ...]:
        """x, y, z [m], q_t, q_x, q_y, q_z; with a constant wind also its speed, or its three components [m/s]."""
        return (*attitude.POSITION, *attitude.ATTITUDE, *(self._winds if self.wind == "constant" else ()))

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """roll_rate, pitch_rate, yaw_rate [rad/s], airspeed_x, airspeed_y, airspeed_z [m/s], all about and along the vehicle's axes."""
        return (*attitude.TURN_RATES, *_AIRSPEED)

    @property
    def disturbances(self) -> tuple[Signal, ...]:
        """The wind where it is unknown, else nothing."""
        return self._winds if self.wind == "unknown" else ()

    @property
    def _winds(self) -> tuple[Signal, ...]:
        return _ANY if self.direction is None else _ALONG

    def fields(self, x: ca.SX) -> Fields:
        """Return the turns (0, q e_i / 2), the axes (q e_i q*, 0), and the wind's directions, as drift where it is constant."""
        import casadi as ca

        q, rest = x[3:7], x.numel() - 7
        turns = tuple(ca.vertcat(ca.SX.zeros(3), column, ca.SX.zeros(rest)) for column in turn_columns(q))
        axes = tuple(ca.vertcat(column, ca.SX.zeros(4 + rest)) for column in axis_columns(q))
        ways = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)) if self.direction is None else (self.direction,)
        winds = tuple(ca.vertcat(ca.SX(list(way)), ca.SX.zeros(4 + rest)) for way in ways)
        drift = ca.horzcat(*winds) @ x[7:] if self.wind == "constant" else ca.SX.zeros(x.numel())
        return Fields(drift, (*turns, *axes), winds if self.wind == "unknown" else ())
