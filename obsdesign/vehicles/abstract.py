"""What a vehicle is: signals, and the vector fields that move them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca

HEADING = Signal("heading", "rad", is_angle=True)
X, Y = Signal("x", "m"), Signal("y", "m")
WIND = (Signal("wind_x", "m/s"), Signal("wind_y", "m/s"))
SPEED, TURN_RATE = Signal("speed", "m/s"), Signal("turn_rate", "rad/s")


@dataclass(frozen=True)
class Fields:
    """The vector fields of xdot = drift + sum_i inputs_i u_i + sum_j disturbances_j w_j, each (n, 1).

    derived: what sensors read of the state that is no state of the vehicle, by name: x and y of one that counts in other coordinates.
    """

    drift: ca.SX
    inputs: tuple[ca.SX, ...]
    disturbances: tuple[ca.SX, ...] = ()
    derived: Mapping[str, ca.SX] = field(default_factory=dict)


class AbstractVehicle(ABC):
    """A control-affine vehicle. Leaves are final frozen dataclasses, one file each."""

    @property
    @abstractmethod
    def states(self) -> tuple[Signal, ...]:
        """The n state components, in order."""

    @property
    @abstractmethod
    def inputs(self) -> tuple[Signal, ...]:
        """The inputs that are known unless the system declares them unknown."""

    @property
    @abstractmethod
    def disturbances(self) -> tuple[Signal, ...]:
        """The inputs that nobody knows."""

    @abstractmethod
    def fields(self, x: ca.SX) -> Fields:
        """Return the vector fields at the symbolic state x (n, 1)."""
