"""Instants of a path, as limits and costs see them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from obsdesign.errors import InputError
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


@dataclass(frozen=True)
class NoRates(Mapping[str, Coordinate]):
    """The rates of a map from one instant to the next: there are none, and who asks for one is told so."""

    names: tuple[str, ...]

    def __getitem__(self, name: str) -> Coordinate:
        raise InputError(f"the rate of {name!r} is asked for, and a map from one instant to the next has no rates")

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)
