"""Scales and biases of sensors that are states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from obsdesign.errors import InputError
from obsdesign.sensors._group import sensor_groups
from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.signals import Signal


@dataclass(frozen=True)
class CorrectionStates:
    """Which states correct the outputs of one sensor: h_i becomes scale h_i + bias_i; names, None where there is none."""

    scale: str | None
    biases: tuple[str | None, ...]


def corrections_of(sensor: AbstractSensor) -> CorrectionStates:
    """Return the names of the states of a sensor: one scale for all outputs but angles, a bias for each output."""
    if sensor.bias is None:
        biases: tuple[str | None, ...] = (None,) * len(sensor.outputs)
    elif len(sensor.outputs) == 1:
        biases = (sensor.bias,)
    else:
        biases = tuple(f"{sensor.bias}{signal.name.removeprefix(sensor.name)}" for signal in sensor.outputs)
    return CorrectionStates(sensor.scale, biases)


def correction_states(sensors: Sequence[AbstractSensor], taken: Mapping[str, str]) -> tuple[Signal, ...]:
    """Return the states that scales and biases of sensors are, once each, in the order of the sensors.

    taken: name -> what of the system already bears it. Raises InputError for such names, and where sensors share a state of two units.
    """
    states: dict[str, Signal] = {}
    for sensor in sensors:
        names = corrections_of(sensor)
        wanted = [] if names.scale is None else [Signal(names.scale)]
        wanted += [
            Signal(name, signal.unit, signal.is_angle)
            for name, signal in zip(names.biases, sensor.outputs, strict=True)
            if name is not None
        ]
        for state in wanted:
            if state.name in taken:
                raise InputError(f"{sensor.name}: the state {state.name!r} has the name of {taken[state.name]}: must be another")
            if states.setdefault(state.name, state) != state:
                units = f"{states[state.name].unit!r} and {state.unit!r}"
                raise InputError(f"{sensor.name}: the state {state.name!r} is shared by outputs of the units {units}: must be one")
    return tuple(states.values())


def system_states(states: tuple[Signal, ...], inputs: tuple[Signal, ...], sensors: Sequence[AbstractSensor]) -> tuple[Signal, ...]:
    """Return a vehicle's states, then scales and biases of sensors; raise InputError for those whose names are taken."""
    taken = {signal.name: "a state" for signal in states} | {signal.name: "an input" for signal in inputs}
    taken |= {signal.name: "an output" for group in sensor_groups(sensors) for signal in group.outputs}
    return (*states, *correction_states(sensors, taken))
