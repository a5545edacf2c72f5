"""A sensor that is of no use, or does not work, without another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.errors import InputError
from obsdesign.rules._given import Sensor
from obsdesign.rules.abstract import AbstractRule, Segments, Terms

if TYPE_CHECKING:
    import numpy as np


@validate_arguments
@dataclass(frozen=True)
class Requires(AbstractRule):
    """A sensor is on only in segments in which the other is on too.

    Raises InputError where both are the same.
    """

    sensor: Sensor
    """Name or index of the sensor that needs the other."""
    other: Sensor
    """Name or index of the sensor that it needs."""

    def __post_init__(self) -> None:
        if self.sensor == self.other:
            raise InputError(f"requires: sensor and other are both {self.sensor!r}: must be two sensors")

    def __str__(self) -> str:
        return f"Requires: {self.sensor} only with {self.other}"

    def terms(self, segments: Segments) -> Terms:
        """Return that patterns with the sensor and without the other are not admissible."""
        sensor, required = segments.sensor(self, self.sensor), segments.sensor(self, self.other)

        def admissible(patterns: np.ndarray) -> np.ndarray:
            """Return which patterns (P,) have the required sensor on wherever the sensor is."""
            return patterns[:, required] | ~patterns[:, sensor]

        return Terms(sensors=(sensor, required), admissible=admissible)
