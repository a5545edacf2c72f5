"""A trolley that nobody steers, with several radio tags on it that range to anchors, as some public files have it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.signals import Point, Signal
from obsdesign.vehicles.abstract import HEADING, SPEED, TURN_RATE, AbstractVehicle, Fields, X, Y

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True)
class Trolley(AbstractVehicle):
    """Rolls along its nose at a speed and a turn rate that are states: xdot = speed cos(heading), ydot = speed sin(heading)."""

    @property
    def states(self) -> tuple[Signal, ...]:
        """x, y [m], heading [rad], speed [m/s], turn_rate [rad/s]."""
        return (X, Y, HEADING, SPEED, TURN_RATE)

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """None."""
        return ()

    @property
    def disturbances(self) -> tuple[Signal, ...]:
        """None: what changes speed and turn rate is process noise."""
        return ()

    def fields(self, x: ca.SX) -> Fields:
        """Return the drift."""
        import casadi as ca

        return Fields(ca.vertcat(x[3] * ca.cos(x[2]), x[3] * ca.sin(x[2]), x[4], 0, 0), ())


@dataclass(frozen=True, kw_only=True)
class TagRanges(AbstractSensor):
    """Distances from one anchor to each of the tags [m]."""

    anchor: tuple[float, float, float]
    tags: tuple[tuple[float, float, float], ...]
    sigma: float

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One distance per tag [m]."""
        return tuple(Signal(f"{self.name}_{i}", "m") for i in range(len(self.tags)))

    @property
    def landmarks(self) -> tuple[Point, ...]:
        """The anchor, seen from above."""
        return (self.anchor[:2],)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return |tag - anchor|; tags (forward, left, height) [m] on the trolley, heights above the floor."""
        import casadi as ca

        forward, left = ca.cos(state["heading"]), ca.sin(state["heading"])
        distances = []
        for a, b, height in self.tags:
            east = state["x"] + forward * a - left * b - self.anchor[0]
            north = state["y"] + left * a + forward * b - self.anchor[1]
            distances.append((east * east + north * north + (height - self.anchor[2]) ** 2) ** 0.5)
        return tuple(distances)

    def spread(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return sigma."""
        import casadi as ca

        return ca.SX(self.sigma)

    def gate(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return 1: every anchor is in range."""
        import casadi as ca

        return ca.SX(1)
