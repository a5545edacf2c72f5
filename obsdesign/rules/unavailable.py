"""Segments in which a sensor does not work."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count
from obsdesign.rules._given import Sensor, sensor_list
from obsdesign.rules.abstract import AbstractRule, Segments, Terms


@validate_arguments
@dataclass(frozen=True)
class Unavailable(AbstractRule):
    """A sensor is off in these segments.

    Raises InputError where the path has no such segment.
    """

    sensor: Sensor
    """Name or index of the sensor."""
    segments: tuple[int, ...]
    """Indices of the segments, counted from 0."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", tuple(self.segments))
        for segment in self.segments:
            require_count("unavailable: segment", segment, minimum=0)

    def __str__(self) -> str:
        shown = self.segments if len(self.segments) <= 6 else (*self.segments[:5], "...")
        return f"Unavailable: {self.sensor} in segments {sensor_list(str(segment) for segment in shown)}"

    def terms(self, segments: Segments) -> Terms:
        """Return that the sensor is not available in the segments; raises InputError for one that the path does not have."""
        import numpy as np

        for segment in self.segments:
            require_count(f"{self}: segment", segment, minimum=0, maximum=segments.count - 1)
        available = np.ones((segments.count, len(segments.names)), dtype=bool)
        available[list(self.segments), segments.sensor(self, self.sensor)] = False
        return Terms(available=available)
