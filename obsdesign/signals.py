"""What a number means: its name, its unit, and whether it wraps."""

from __future__ import annotations

import math
from dataclasses import dataclass

Point = tuple[float, float]  # (x, y) [m]
DEGREES_PER_RADIAN, RADIANS_PER_DEGREE = 180 / math.pi, math.pi / 180
_IN_DEGREES = {"rad": "deg", "rad/s": "deg/s"}


@dataclass(frozen=True)
class Signal:
    """A named scalar: a state, an input or an output."""

    name: str
    """What the files, tables and figures call it."""
    unit: str = ""
    """Its unit, such as "m" or "rad/s"; "" = none."""
    is_angle: bool = False
    """Whether filters and differences wrap it to (-pi, pi]."""

    @property
    def display_unit(self) -> tuple[float, str]:
        """(factor, unit) in which people read it: degrees instead of radians."""
        unit = "rad" if self.is_angle else self.unit
        return (DEGREES_PER_RADIAN, _IN_DEGREES[unit]) if unit in _IN_DEGREES else (1.0, unit)
