"""A mass that is pushed about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.signals import Signal
from obsdesign.vehicles.abstract import AbstractVehicle, Fields, X, Y

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True)
class Puck(AbstractVehicle):
    """xdot = v_x, ydot = v_y, v_xdot = push_x - drag v_x, v_ydot = push_y - drag v_y."""

    drag: float = 0.0
    """What the air takes off the speed [1/s]."""

    @property
    def states(self) -> tuple[Signal, ...]:
        return (X, Y, Signal("v_x", "m/s"), Signal("v_y", "m/s"))

    @property
    def inputs(self) -> tuple[Signal, ...]:
        return (Signal("push_x", "m/s^2"), Signal("push_y", "m/s^2"))

    @property
    def disturbances(self) -> tuple[Signal, ...]:
        return ()

    def fields(self, x: ca.SX) -> Fields:
        import casadi as ca

        drift = ca.vertcat(x[2], x[3], -self.drag * x[2], -self.drag * x[3])
        return Fields(drift, (ca.SX([0, 0, 1, 0]), ca.SX([0, 0, 0, 1])))
