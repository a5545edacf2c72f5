"""A sensor that may only be used so often."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.checks import require_count
from obsdesign.rules._given import Sensor
from obsdesign.rules.abstract import AbstractRule, Resource, Segments, Terms


@dataclass(frozen=True)
class MaxUses(AbstractRule):
    """A sensor is on in at most so many segments.

    Raises InputError unless most is a whole number of at least 0.
    """

    sensor: Sensor
    """Name or index of the sensor."""
    most: int
    """The largest number of segments in which it is on."""

    def __post_init__(self) -> None:
        require_count("max_uses: most", self.most, minimum=0)

    def __str__(self) -> str:
        return f"MaxUses: {self.sensor} in at most {self.most} segments"

    def terms(self, segments: Segments) -> Terms:
        """Return the resource sum_k on_ks <= most."""
        import numpy as np

        usage = np.zeros((segments.count, len(segments.names)))
        usage[:, segments.sensor(self, self.sensor)] = 1.0
        return Terms(resource=Resource(usage, np.zeros(len(segments.names)), float(self.most)))
