"""Speed over ground, whatever way it goes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca

_REST = 0.01  # [m/s] added in the square: the speed has a derivative at rest


@dataclass(frozen=True, kw_only=True)
class Speedometer(AbstractSensor):
    """h = |(v_x, v_y)|."""

    sigma: float
    """Standard deviation of one sample [m/s]."""
    name: str = "speedometer"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        return (Signal(self.name, "m/s"),)

    @property
    def landmarks(self) -> tuple[()]:
        return ()

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return ((state["v_x"] ** 2 + state["v_y"] ** 2 + _REST**2) ** 0.5,)

    def spread(self, state: Mapping[str, ca.SX]) -> ca.SX:
        import casadi as ca

        return ca.SX(self.sigma)

    def gate(self, state: Mapping[str, ca.SX]) -> ca.SX:
        import casadi as ca

        return ca.SX(1.0)
