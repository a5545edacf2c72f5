"""A thing in space that feels its accelerations and turns: an inertial measurement unit, on whatever it is mounted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_finite
from obsdesign.quaternions import axis_columns, turn_columns
from obsdesign.signals import Signal
from obsdesign.vehicles import _attitude as attitude
from obsdesign.vehicles.abstract import AbstractVehicle, Fields

if TYPE_CHECKING:
    import casadi as ca

_VELOCITY = (Signal("velocity_x", "m/s"), Signal("velocity_y", "m/s"), Signal("velocity_z", "m/s"))
_FORCES = (Signal("force_x", "m/s^2"), Signal("force_y", "m/s^2"), Signal("force_z", "m/s^2"))
_FORCE_BIASES = tuple(Signal(f"{signal.name}_bias", signal.unit) for signal in _FORCES)
_RATE_BIASES = tuple(Signal(f"{signal.name}_bias", signal.unit) for signal in attitude.TURN_RATES)
_GRAVITY = Signal("gravity", "m/s^2")
STANDARD_GRAVITY = 9.80665  # m/s^2


@validate_arguments
@dataclass(frozen=True)
class InertialVisual(AbstractVehicle):
    """Accelerometers and gyroscopes in space: rdot = v, vdot = q (A - a) q* - g e_z, qdot = q (Omega - b) / 2, in the map's axes.

    Inputs force_x, force_y, force_z [m/s^2] are what accelerometers read, A, and roll_rate, pitch_rate, yaw_rate [rad/s] what gyroscopes
    read, Omega, along and about their own axes; a and b are their constant biases. Raises InputError for other values.
    Source: Martinelli 2012, IEEE Trans. Robotics 28, 44-60.
    """

    gravity: float | None = STANDARD_GRAVITY
    """g [m/s^2], downwards along z; None = a state to be estimated."""
    biases: bool = False
    """Whether the biases are states to be estimated, else they are 0."""

    def __post_init__(self) -> None:
        if self.gravity is not None:
            require_finite("gravity", self.gravity)

    @property
    def states(self) -> tuple[Signal, ...]:
        """x, y, z [m], velocity_x, ... [m/s], q_t, q_x, q_y, q_z; biases of forces and turn rates, gravity, where they are states."""
        biases = (*_FORCE_BIASES, *_RATE_BIASES) if self.biases else ()
        return (*attitude.POSITION, *_VELOCITY, *attitude.ATTITUDE, *biases, *((_GRAVITY,) if self.gravity is None else ()))

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """roll_rate, pitch_rate, yaw_rate [rad/s], force_x, force_y, force_z [m/s^2]."""
        return (*attitude.TURN_RATES, *_FORCES)

    @property
    def disturbances(self) -> tuple[Signal, ...]:
        """None."""
        return ()

    def fields(self, x: ca.SX) -> Fields:
        """Return the turns q e_i / 2, the axes q e_i q* of the forces; velocity, gravity and biases are the drift."""
        import casadi as ca

        n, q = x.numel(), x[6:10]
        turns = tuple(_placed(column, 6, n) for column in turn_columns(q))
        axes = tuple(_placed(column, 3, n) for column in axis_columns(q))
        g = x[n - 1] if self.gravity is None else ca.SX(self.gravity)
        drift = _placed(x[3:6], 0, n) + _placed(ca.vertcat(0, 0, -g), 3, n)
        if self.biases:
            drift -= ca.horzcat(*axes, *turns) @ x[10:16]
        return Fields(drift, (*turns, *axes))


def _placed(column: ca.SX, first: int, n: int) -> ca.SX:
    """The column (n, 1) that has these rows from `first` on, and 0 elsewhere."""
    import casadi as ca

    return ca.vertcat(ca.SX.zeros(first), column, ca.SX.zeros(n - first - column.numel()))
