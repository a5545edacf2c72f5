"""Sensors one of which has to be on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.rules.abstract import AbstractRule, Segments, Terms

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class OneOf(AbstractRule):
    """At least one of these sensors is on in every segment."""

    sensors: tuple[str, ...]
    """Names of the sensors."""

    def __str__(self) -> str:
        return f"OneOf: {', '.join(self.sensors)}"

    def terms(self, segments: Segments) -> Terms:
        group = segments.sensors(self, self.sensors)

        def admissible(patterns: np.ndarray) -> np.ndarray:
            return patterns[:, list(group)].any(axis=1)

        return Terms(sensors=group, admissible=admissible)
