"""Directions to several landmarks at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_pair
from obsdesign.errors import InputError
from obsdesign.sensors._onboard import AbstractOnboard
from obsdesign.signals import Point, Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class RelativeBearing(AbstractOnboard):
    """Directions to several landmarks off the vehicle's nose, in one sample: h_i = atan2(landmark_i - position) - heading [rad], wrapped.

    What `bearing` reads of each of them. Raises InputError for no landmark and for one that stands there twice.
    Source: Belo, Salaris and Bicchi 2010, eq. 3.
    """

    beacons: tuple[Point, ...]
    """Where the landmarks stand (x, y) [m]."""
    name: str = "relative_bearing"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "beacons", tuple(as_pair(f"{self.name}: beacons", place) for place in self.beacons))
        if not self.beacons:
            raise InputError(f"{self.name}: beacons is empty: must have at least one landmark")
        for i, place in enumerate(self.beacons):
            if place in self.beacons[:i]:
                raise InputError(f"{self.name}: beacons has {place} twice")

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """An angle [rad] for each landmark, wrapped."""
        return tuple(Signal(f"{self.name}_{i}", "rad", is_angle=True) for i in range(1, len(self.beacons) + 1))

    @property
    def landmarks(self) -> tuple[Point, ...]:
        """The landmarks."""
        return self.beacons

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return the directions off the nose."""
        import casadi as ca

        return tuple(ca.atan2(north - state["y"], east - state["x"]) - state["heading"] for east, north in self.beacons)
