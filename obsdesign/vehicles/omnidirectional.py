"""A planar robot that drives forward and sideways and turns, while it slips."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from obsdesign.arguments import validate_arguments
from obsdesign.errors import InputError
from obsdesign.signals import Signal
from obsdesign.vehicles import _planar as planar
from obsdesign.vehicles.abstract import HEADING, TURN_RATE, AbstractVehicle, Fields, X, Y

if TYPE_CHECKING:
    import casadi as ca

Disturbance = Literal["constant", "unknown"]
_INPUTS = (Signal("forward", "m/s"), Signal("sideways", "m/s"), TURN_RATE)
_SLIPS = (Signal("forward_slip", "m/s"), Signal("side_slip", "m/s"), Signal("turn_slip", "rad/s"))


@validate_arguments
@dataclass(frozen=True)
class Omnidirectional(AbstractVehicle):
    """A vehicle that moves forward, sideways and around independently, and may slip in all three.

    xdot = f cos(heading) - s sin(heading), ydot = f sin(heading) + s cos(heading), headingdot = o.
    f = forward + forward_slip, s = sideways + side_slip [m/s], to the left of the nose when > 0, o = turn_rate + turn_slip
    [rad/s], counter-clockwise: axes of the vehicle, not of the map. forward, sideways and turn_rate are inputs.
    Raises InputError for other values. Source: Belo, Salaris and Bicchi 2010, eq. 2, whose map has the axes x and z for x and y.
    """

    disturbance: Disturbance | None = None
    """None (no slip), "constant" (the three slips are states to be estimated) or "unknown" (unknown inputs of those names)."""

    def __post_init__(self) -> None:
        if self.disturbance not in (None, "constant", "unknown"):
            names = ", ".join(signal.name for signal in _SLIPS)
            accepted = f"None, 'constant' (states {names}) or 'unknown' (unknown inputs of those names)"
            raise InputError(f"disturbance is {self.disturbance!r}: must be {accepted}")

    @property
    def states(self) -> tuple[Signal, ...]:
        """x, y [m], heading [rad]; constant slips also as states."""
        return (X, Y, HEADING) + (_SLIPS if self.disturbance == "constant" else ())

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """forward, sideways [m/s] and turn_rate [rad/s]."""
        return _INPUTS

    @property
    def disturbances(self) -> tuple[Signal, ...]:
        """The three slips where they are unknown, else nothing."""
        return _SLIPS if self.disturbance == "unknown" else ()

    def fields(self, x: ca.SX) -> Fields:
        """Return the fields along the nose, to its left and around, for the inputs and for unknown slips; constant slips are the drift."""
        import casadi as ca

        n = x.numel()
        sideways = ca.vertcat(-ca.sin(x[2]), ca.cos(x[2]), ca.SX.zeros(n - 2))
        motions = (planar.forward_field(x), sideways, planar.turn_field(x))
        slipping = ca.horzcat(*motions) @ x[3:] if self.disturbance == "constant" else ca.SX.zeros(n)
        return Fields(slipping, motions, motions if self.disturbance == "unknown" else ())
