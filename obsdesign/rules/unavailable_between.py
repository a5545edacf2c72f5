"""A time at which a sensor does not work: a night, a jammed stretch."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_within
from obsdesign.errors import InputError
from obsdesign.rules._given import Sensor
from obsdesign.rules.abstract import AbstractRule, Segments, Terms


@validate_arguments
@dataclass(frozen=True)
class UnavailableBetween(AbstractRule):
    """A sensor is off in every segment that shares time with the stretch from first to last.

    Raises InputError unless 0 <= first < last.
    """

    sensor: Sensor
    """Name or index of the sensor."""
    first: float
    """Beginning of the stretch [s]."""
    last: float
    """End of the stretch [s]."""

    def __post_init__(self) -> None:
        require_within("unavailable_between: first", self.first)
        require_within("unavailable_between: last", self.last)
        if self.last <= self.first:
            raise InputError(f"unavailable_between: last is {self.last!r}: must be after first, {self.first!r}")

    def __str__(self) -> str:
        return f"UnavailableBetween: {self.sensor} from {self.first:g} s to {self.last:g} s"

    def terms(self, segments: Segments) -> Terms:
        """Return that the sensor is not available in segments that overlap [first, last]; raises InputError without times."""
        import numpy as np

        if segments.t is None:
            raise InputError(f"{self}: the times of the segments are not known: give select_sensors segments=Segments(..., t=...)")
        t = segments.t - segments.t[0]
        available = np.ones((segments.count, len(segments.names)), dtype=bool)
        available[(t[:-1] < self.last) & (t[1:] > self.first), segments.sensor(self, self.sensor)] = False
        return Terms(available=available)
