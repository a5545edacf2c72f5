"""Distance to a beacon."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.sensors._beacon import AbstractSingleBeacon
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class Range(AbstractSingleBeacon):
    """Distance to a beacon: h = |beacon - sensor| [m].

    Source: Brace and Morgansen, Table I.
    """

    name: str = "range"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One distance [m]."""
        return (Signal(self.name, "m"),)

    @property
    def nose(self) -> float:
        """0: it looks ahead."""
        return 0.0

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return |beacon - sensor|."""
        return (self.distance(self.only_beacon, state),)

    def spread(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return sqrt(sigma^2 + (sigma_per_metre r)^2)."""
        return self.spread_with(self.sigma, state)
