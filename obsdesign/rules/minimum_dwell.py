"""A sensor that is switched on stays on for a while."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count
from obsdesign.rules._given import Sensor, as_sensors, sensor_list
from obsdesign.rules.abstract import AbstractRule, Segments, Terms


@validate_arguments
@dataclass(frozen=True)
class MinimumDwell(AbstractRule):
    """A sensor that is switched on stays on for at least so many segments, or to the end of the path.

    Raises InputError unless least is a whole number of at least 1.
    """

    least: int
    """The smallest number of segments in a row."""
    sensors: tuple[Sensor, ...] | None = None
    """Names or indices of the sensors that the rule is for; None = each of them."""

    def __post_init__(self) -> None:
        require_count("minimum_dwell: least", self.least)
        if self.sensors is not None:
            object.__setattr__(self, "sensors", as_sensors("minimum_dwell: sensors", self.sensors))

    def __str__(self) -> str:
        return f"MinimumDwell: {sensor_list(self.sensors)} for at least {self.least} segments"

    def terms(self, segments: Segments) -> Terms:
        """Return the dwell of each sensor (S,), 1 for those that the rule is not for."""
        import numpy as np

        dwell = np.ones(len(segments.names), dtype=int)
        dwell[list(segments.sensors(self, self.sensors))] = self.least
        return Terms(dwell=dwell)
