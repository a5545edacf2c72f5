"""Sensors that disturb each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.rules._given import Sensor, as_sensors, sensor_list
from obsdesign.rules.abstract import AbstractRule, Segments, Terms

if TYPE_CHECKING:
    import numpy as np


@validate_arguments
@dataclass(frozen=True)
class Exclusive(AbstractRule):
    """At most one of these sensors is on in a segment.

    Raises InputError for fewer than two sensors.
    """

    sensors: tuple[Sensor, ...]
    """Names or indices of two or more sensors."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", as_sensors("exclusive: sensors", self.sensors, minimum=2))

    def __str__(self) -> str:
        return f"Exclusive: {sensor_list(self.sensors)}"

    def terms(self, segments: Segments) -> Terms:
        """Return that patterns with more than one of the sensors are not admissible."""
        group = segments.sensors(self, self.sensors)

        def admissible(patterns: np.ndarray) -> np.ndarray:
            """Return which patterns (P,) have at most one of the sensors on."""
            return patterns[:, list(group)].sum(axis=1) <= 1

        return Terms(sensors=group, admissible=admissible)
