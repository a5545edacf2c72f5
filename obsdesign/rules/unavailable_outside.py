"""A place outside which a sensor does not work: the reach of a beacon."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_pair, require_positive
from obsdesign.errors import InputError
from obsdesign.rules._given import Sensor
from obsdesign.rules.abstract import AbstractRule, Segments, Terms
from obsdesign.signals import Point


@validate_arguments
@dataclass(frozen=True)
class UnavailableOutside(AbstractRule):
    """A sensor is off in every segment that leaves a circle.

    Raises InputError for other values, and where no path is known.
    """

    sensor: Sensor
    """Name or index of the sensor."""
    centre: Point
    """Middle of the circle (x, y) [m]."""
    radius: float
    """Radius of the circle [m], > 0."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", as_pair("unavailable_outside: centre", self.centre))
        require_positive("unavailable_outside: radius", self.radius)

    def __str__(self) -> str:
        return f"UnavailableOutside: {self.sensor} farther than {self.radius:g} m from ({self.centre[0]:g}, {self.centre[1]:g})"

    def terms(self, segments: Segments) -> Terms:
        """Return that the sensor is not available in segments with a position outside; raises InputError without positions."""
        import numpy as np

        if segments.tracks is None:
            raise InputError(f"{self}: the positions are not known: give select_sensors segments=Segments(..., tracks=...)")
        far = [np.hypot(*(track - self.centre).T).max() > self.radius for track in segments.tracks]
        available = np.ones((segments.count, len(segments.names)), dtype=bool)
        available[far, segments.sensor(self, self.sensor)] = False
        return Terms(available=available)
