"""Angles in degrees: under their key with the suffix _deg."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from obsdesign.errors import InputError
from obsdesign.scenario.kind_tables import SUFFIX
from obsdesign.signals import Signal

if TYPE_CHECKING:
    from obsdesign.dynamics.system_text import SystemText
    from obsdesign.scenario.schema import Scenario

_SPREADS = ("sigma", "bias_floor", "sigma_per_metre")  # in the unit of what a sensor measures
_NOT_IN_SENSOR_UNIT = ("rate", "inflation", "correlation", "detection", "max_range", "beacon", "height", "lever_arm")  # of a sensor
_SYSTEM, _OUTPUTS = "system", "outputs"
_NO_ANGLES = ("vehicle", "time", "path", "prices", "budgets", "floor", "robust", "flight", "validation", "selection")


def in_radians(value: Any) -> Any:  # noqa: ANN401  # whatever TOML can hold
    """Return TOML data with every number under a key that ends in _deg converted to radians, under the key without it."""
    if isinstance(value, Mapping):
        return {_without(key, item): _convert(key, item) for key, item in value.items()}
    return [in_radians(item) for item in value] if isinstance(value, list) else value


def scenario_in_radians(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the TOML data of a scenario in radians; of a system as text its outputs alone, as other keys are names."""
    table = data.get(_SYSTEM)
    if not isinstance(table, Mapping):
        return in_radians(data)
    rest = in_radians({key: item for key, item in data.items() if key != _SYSTEM})
    return {**rest, _SYSTEM: {key: in_radians(item) if key == _OUTPUTS else item for key, item in table.items()}}


def non_angles(data: Mapping[str, Any], scenario: Scenario) -> Iterator[tuple[str | int, ...]]:
    """Yield where the data of a valid scenario give something in degrees that is no angle."""
    for location in _in_degrees(data, ()):
        if not _may_be_angle(scenario, location):
            yield location


def _in_degrees(value: Any, location: tuple[str | int, ...]) -> Iterator[tuple[str | int, ...]]:  # noqa: ANN401
    parts = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    for key, item in parts:
        if location == (_SYSTEM,) and key != _OUTPUTS:
            continue  # names, which are called as somebody likes
        if isinstance(key, str) and key.endswith(SUFFIX) and _is_angle(item):
            yield (*location, key)
        else:
            yield from _in_degrees(item, (*location, key))


def _may_be_angle(scenario: Scenario, location: tuple[str | int, ...]) -> bool:
    name, signals = str(location[-1]).removesuffix(SUFFIX), _signals(scenario)
    unit = next((signal.unit for signal in signals if signal.name == name), "rad")
    if location[0] == "place":
        return name == "bearing"
    if location[0] == _SYSTEM:
        return name in _SPREADS and _is_angular_output(scenario.system_text, str(location[2]))
    if location[0] == "sensors":
        measures_angles = all(signal.is_angle for signal in scenario.sensors[int(location[1])].outputs)
        return name not in _NOT_IN_SENSOR_UNIT and (measures_angles or name not in _SPREADS)
    if location[:2] == ("selection", "requirements"):
        about = scenario.selection.requirements[int(location[2])].about
        return name == "at_most" and all(signal.unit.startswith("rad") for signal in signals if signal.name in about)
    return unit.startswith("rad") and not set(_NO_ANGLES) & set(location[:-1])


def non_angular_spreads(outputs: Any, text: SystemText) -> Iterator[tuple[str | int, ...]]:  # noqa: ANN401
    """Yield where the data of a system's valid outputs give something in degrees that is no angle."""
    for location in _in_degrees(outputs, (_SYSTEM, _OUTPUTS)):
        if not _is_angular_output(text, str(location[2])):
            yield location


def _is_angular_output(text: SystemText | None, name: str) -> bool:
    """Whether an output of a system as text is in radians, or in no unit that can be told."""
    output = next((output for output in text.outputs if output.name == name), None) if text is not None else None
    if text is None or output is None:
        return False
    try:
        return all(text.unit_of(output, formula) in ("rad", "") for formula in output.formulas)
    except (InputError, KeyError):  # formulas and names that are wrong, which is said elsewhere
        return True


def _signals(scenario: Scenario) -> tuple[Signal, ...]:
    try:
        return (*scenario.states, *scenario.inputs)
    except InputError:  # sensors that do not fit together, which is said elsewhere
        return (*scenario.moving_states, *scenario.inputs)


def _is_angle(item: Any) -> bool:  # noqa: ANN401
    numbers = item if isinstance(item, list) else [item]
    return all(isinstance(number, (int, float)) and not isinstance(number, bool) for number in numbers)


def _without(key: str, item: Any) -> str:  # noqa: ANN401
    return key.removesuffix(SUFFIX) if _is_angle(item) else key


def _convert(key: str, item: Any) -> Any:  # noqa: ANN401
    if not (key.endswith(SUFFIX) and _is_angle(item)):
        return in_radians(item)
    return [math.radians(number) for number in item] if isinstance(item, list) else math.radians(item)
