"""Sensors that are one thing: what reports, schedules and rules count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from obsdesign.errors import InputError
from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.signals import Point, Signal

_SHARED = ("rate", "inflation", "correlation", "detection")  # what belongs to the whole group


@dataclass(frozen=True)
class SensorGroup:
    """One sensor, or several of one `group`: on, off and arriving together.

    Raises InputError where sensors of a group differ in what belongs to the whole of it.
    """

    name: str
    sensors: tuple[AbstractSensor, ...]

    def __post_init__(self) -> None:
        for field in _SHARED:
            values = [getattr(sensor, field) for sensor in self.sensors]
            if len(set(values)) > 1:
                told = ", ".join(f"{value}" for value in values)
                raise InputError(f"group {self.name!r}: {field} of its sensors is {told}: must be the same, they come together")

    @cached_property
    def outputs_of(self) -> tuple[tuple[Signal, ...], ...]:
        """The outputs of each sensor, with the names that they have in the system."""
        if self.sensors[0].group is None:
            return (_with_name(self.sensors[0], self.name),)
        return tuple(
            _with_name(sensor, f"{self.name}_{name}") for name, sensor in zip(unique_names(self.sensors, "name"), self.sensors, strict=True)
        )

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """All outputs."""
        return tuple(signal for outputs in self.outputs_of for signal in outputs)

    @property
    def correlation(self) -> float:
        """Correlation of the noise of successive samples."""
        return self.sensors[0].correlation

    @property
    def bias_floor(self) -> float | tuple[float, ...]:
        """Standard deviation of the constant error of each output, one number where all have the same."""
        if len({sensor.bias_floor for sensor in self.sensors}) == 1:
            return self.sensors[0].bias_floor
        return tuple(sensor.bias_floor for sensor in self.sensors for _ in sensor.outputs)

    @property
    def landmarks(self) -> tuple[Point, ...]:
        """Distinct points that its sensors look at."""
        return tuple(dict.fromkeys(point for sensor in self.sensors for point in sensor.landmarks))


def sensor_groups(sensors: Sequence[AbstractSensor]) -> tuple[SensorGroup, ...]:
    """Return the things that the sensors are, a group where its first sensor stands; two of one name are told apart by a number."""
    first: dict[str, AbstractSensor] = {}
    for sensor in sensors:
        if sensor.group is not None:
            first.setdefault(sensor.group, sensor)
    heads = [sensor for sensor in sensors if sensor.group is None or first[sensor.group] is sensor]
    members = [(head,) if head.group is None else tuple(s for s in sensors if s.group == head.group) for head in heads]
    return tuple(SensorGroup(name, each) for name, each in zip(unique_names(heads, "group"), members, strict=True))


def distinct_names(sensors: Sequence[AbstractSensor]) -> tuple[str, ...]:
    """Return the names of the things that the sensors are, the second of one name numbered: range, range_2."""
    return tuple(group.name for group in sensor_groups(sensors))


def unique_names(sensors: Sequence[AbstractSensor], by: str) -> tuple[str, ...]:
    """Return the sensors' names, or those of their groups, the second of one name numbered."""
    names = [sensor.group if by == "group" and sensor.group is not None else sensor.name for sensor in sensors]
    earlier = [names[:i].count(name) for i, name in enumerate(names)]
    return tuple(f"{name}_{count + 1}" if count else name for name, count in zip(names, earlier, strict=True))


def _with_name(sensor: AbstractSensor, name: str) -> tuple[Signal, ...]:
    return tuple(replace(signal, name=signal.name.replace(sensor.name, name, 1)) for signal in sensor.outputs)
