"""Compass heading."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.sensors._onboard import AbstractOnboard
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class Magnetometer(AbstractOnboard):
    """Compass: h = heading [rad].

    Source: Brace and Morgansen, Table I.
    """

    name: str = "magnetometer"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One angle [rad], wrapped."""
        return (Signal(self.name, "rad", is_angle=True),)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return the heading."""
        return (state["heading"],)
