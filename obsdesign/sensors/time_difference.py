"""Difference of the distances to two beacons."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_pair, require_finite
from obsdesign.errors import InputError
from obsdesign.sensors._beacon import AbstractBeaconSensor, Beacon
from obsdesign.signals import Point, Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class TimeDifference(AbstractBeaconSensor):
    """Difference of arrival times, as distances: h = |beacon - sensor| - |reference - sensor| [m], time times speed of the signal.

    One sample needs both beacons: limits of range and view hold for each, and sigma_per_metre counts for both distances. On the line
    through the beacons, outside of them, the output is their distance from each other to first order, and says nothing.
    Raises InputError for a reference at the beacon, and values outside the ranges below.
    Source: Foy (1976), IEEE Trans. Aerosp. Electron. Syst. 12, 187-194.
    """

    reference: Point
    """Where the beacon stands whose distance is taken off (x, y) [m]."""
    reference_height: float = field(default=0.0, kw_only=True)
    """How far the reference is above or below the sensor, or above the surface where the vehicle has a depth [m]."""
    name: str = "time_difference"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "reference", as_pair(f"{self.name}: reference", self.reference))
        require_finite(f"{self.name}: reference_height", self.reference_height)
        if (self.reference, self.reference_height) == (self.beacon, self.height):
            raise InputError(f"{self.name}: reference is {self.reference!r}: must not be the beacon, the difference would be 0 everywhere")

    @property
    def beacons(self) -> tuple[Beacon, ...]:
        """The beacon and the reference."""
        return (Beacon(self.beacon, self.height), Beacon(self.reference, self.reference_height))

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One difference [m]."""
        return (Signal(self.name, "m"),)

    @property
    def nose(self) -> float:
        """0: it looks ahead."""
        return 0.0

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return |beacon - sensor| - |reference - sensor|."""
        beacon, reference = self.beacons
        return (self.distance(beacon, state) - self.distance(reference, state),)

    def spread(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return sqrt(sigma^2 + sigma_per_metre^2 (r^2 + r_reference^2))."""
        return self.spread_with(self.sigma, state)
