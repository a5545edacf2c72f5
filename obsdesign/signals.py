"""What a number means: its name, its unit, and whether it wraps."""

from __future__ import annotations

from dataclasses import dataclass

Point = tuple[float, float]  # (x, y) [m]


@dataclass(frozen=True)
class Signal:
    """A named scalar: a state, an input or an output."""

    name: str
    """What the files, tables and figures call it."""
    unit: str = ""
    """Its unit, such as "m" or "rad/s"; "" = none."""
    is_angle: bool = False
    """Whether filters and differences wrap it to (-pi, pi]."""
