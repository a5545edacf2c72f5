"""Satellite position."""

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
class GPS(AbstractOnboard):
    """Position in the plane: h = (x, y) [m].

    Source: Brace and Morgansen, Table I.
    """

    name: str = "gps"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """Two positions [m]."""
        return (Signal(f"{self.name}_x", "m"), Signal(f"{self.name}_y", "m"))

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return (x, y)."""
        return (state["x"], state["y"])
