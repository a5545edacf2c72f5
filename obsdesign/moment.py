"""Instants of a path, as limits and costs see them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from obsdesign.signals import Point

# one or more instants: floats, NumPy arrays and SX scalars alike, so one definition serves check and design
Coordinate = Any


@dataclass(frozen=True, eq=False)
class Moment:
    """Instants of a path: states, their rates of change and the inputs held there by name, elementwise; landmarks of the sensors."""

    state: Mapping[str, Coordinate]
    rate: Mapping[str, Coordinate]
    inputs: Mapping[str, Coordinate]
    landmarks: Sequence[Point] = ()
