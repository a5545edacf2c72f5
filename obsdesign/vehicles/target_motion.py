"""A target, as seen from a vehicle that knows its own acceleration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from obsdesign.arguments import validate_arguments
from obsdesign.errors import InputError
from obsdesign.signals import Signal
from obsdesign.vehicles.abstract import AbstractVehicle, Fields, X, Y

if TYPE_CHECKING:
    import casadi as ca

Target = Literal["constant velocity", "unknown acceleration"]
_VELOCITY = (Signal("velocity_x", "m/s"), Signal("velocity_y", "m/s"))
_OWN = (Signal("own_acceleration_x", "m/s^2"), Signal("own_acceleration_y", "m/s^2"))
_TARGETS = (Signal("acceleration_x", "m/s^2"), Signal("acceleration_y", "m/s^2"))


@validate_arguments
@dataclass(frozen=True)
class TargetMotion(AbstractVehicle):
    """Where a target is and how it moves relative to the observer: pdot = v, vdot = a - own acceleration, in axes that do not turn.

    States x, y [m] from the observer to the target, velocity_x, velocity_y [m/s] of the target less the observer's. Inputs
    own_acceleration_x, own_acceleration_y [m/s^2]. What the observer measures are `range`, `global_bearing`, `doppler` of a beacon at
    (0, 0): distances and their rates are the same both ways, and a bearing is turned by half a turn. Raises InputError for other values.
    Source: Nardone and Aidala 1981, IEEE Trans. Aerospace and Electronic Systems 17, 162-166.
    """

    target: Target = "constant velocity"
    """Whether the target keeps its velocity, or accelerates as nobody knows (unknown inputs acceleration_x, acceleration_y [m/s^2])."""

    def __post_init__(self) -> None:
        if self.target not in ("constant velocity", "unknown acceleration"):
            raise InputError(f"target is {self.target!r}: must be 'constant velocity' or 'unknown acceleration'")

    @property
    def states(self) -> tuple[Signal, ...]:
        """x, y [m], velocity_x, velocity_y [m/s]."""
        return (X, Y, *_VELOCITY)

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """own_acceleration_x, own_acceleration_y [m/s^2]."""
        return _OWN

    @property
    def disturbances(self) -> tuple[Signal, ...]:
        """acceleration_x, acceleration_y [m/s^2] where the target accelerates."""
        return _TARGETS if self.target == "unknown acceleration" else ()

    def fields(self, x: ca.SX) -> Fields:
        """Return the velocity as drift, and the accelerations."""
        import casadi as ca

        pushes = tuple(ca.SX([float(row == axis) for row in range(4)]) for axis in (2, 3))
        disturbances = pushes if self.target == "unknown acceleration" else ()
        return Fields(ca.vertcat(x[2], x[3], 0, 0), tuple(-push for push in pushes), disturbances)
