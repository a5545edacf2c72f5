"""Checking what the constructors of rules are given, and spelling it in messages."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from numbers import Real
from typing import Any

from obsdesign.errors import InputError

Sensor = str | int


def as_numbers(what: str, value: Any) -> float | dict[Sensor, float]:  # noqa: ANN401  # whatever a caller gave
    """Return a number >= 0, or a table of them by sensor, or raise InputError."""
    if isinstance(value, Mapping):
        return {sensor: _number(f"{what} of {sensor}", number) for sensor, number in value.items()}
    return _number(what, value)


def as_sensors(what: str, value: Any, minimum: int = 1) -> tuple[Sensor, ...]:  # noqa: ANN401
    """Return at least so many distinct sensors, by name or index, as a tuple, or raise InputError."""
    sensors = (value,) if isinstance(value, str) or not isinstance(value, Iterable) else tuple(value)
    if len(set(sensors)) != len(sensors) or len(sensors) < minimum or not all(_is_sensor(sensor) for sensor in sensors):
        raise InputError(f"{what} is {value!r}: must be at least {minimum} different sensor{'s' if minimum > 1 else ''}, by name or index")
    return sensors


def _is_sensor(value: Any) -> bool:  # noqa: ANN401
    return isinstance(value, str) or (isinstance(value, int) and not isinstance(value, bool))


def _number(what: str, value: Any) -> float:  # noqa: ANN401
    if isinstance(value, bool) or not (isinstance(value, Real) and math.isfinite(value) and float(value) >= 0):
        raise InputError(f"{what} is {value!r}: must be a finite number of at least 0")
    return float(value)


def sensor_list(sensors: Iterable[Sensor] | None) -> str:
    """Return sensors as words: gps, range."""
    return "every sensor" if sensors is None else ", ".join(str(sensor) for sensor in sensors)
