"""Compass heading."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True)
class Magnetometer(AbstractSensor):
    """h = heading; sigma [rad]. Source: Brace and Morgansen, Table I."""

    sigma: float
    rate: float | None = None
    name: str = "magnetometer"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        return (Signal(self.name, "rad", is_angle=True),)

    @property
    def landmark(self) -> None:
        return None

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (state["heading"],)
