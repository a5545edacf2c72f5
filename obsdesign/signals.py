"""What a number means: its name, its unit, and whether it wraps."""

from __future__ import annotations

from dataclasses import dataclass

Point = tuple[float, float]  # (x, y) [m]


@dataclass(frozen=True)
class Signal:
    """A named scalar. `is_angle` tells filters and differences to wrap it to (-pi, pi]."""

    name: str
    unit: str = ""
    is_angle: bool = False
