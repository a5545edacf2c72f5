"""The runs of a sweep: a scenario's keys, set to every combination of values."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import Any

from obsdesign.checks import require_known
from obsdesign.errors import InputError
from obsdesign.scenario.degrees import SUFFIX
from obsdesign.scenario.schema import Scenario

SENSORS = "sensors"  # the key whose values are subsets, named by their sensors
_OF_THE_FILE = ("sweep", "expected")  # keys that say nothing of what a run computes
Values = tuple[tuple[str, Any], ...]  # what one run varies: key and value, in the order of the keys


def combinations_of(vary: Mapping[str, Iterable[Any]]) -> tuple[Values, ...]:
    """Return every combination of the values of the keys, the last key fastest.

    Raises InputError for no key, for a key without values or with one of them twice, and for values that no scenario holds.
    """
    if not vary:
        raise InputError("vary is empty: must have at least one key of the scenario, such as 'sensors.gps.sigma', with its values")
    for key, values in vary.items():
        if isinstance(values, str | Mapping) or not isinstance(values, Iterable):
            raise InputError(f"vary[{key!r}] is {values!r}: must be a list of values")
    columns = {key: [_plain(key, value) for value in values] for key, values in vary.items()}
    for key, values in columns.items():
        repeated = [value for i, value in enumerate(values) if value in values[:i]]
        if not values or repeated:
            raise InputError(f"vary[{key!r}] " + (f"has {repeated[0]!r} twice" if repeated else "has no values: must have at least one"))
    return tuple(tuple(zip(columns, row, strict=True)) for row in product(*columns.values()))


def varied_data(scenario: Scenario, values: Values) -> dict[str, Any]:
    """Return what the scenario's file says, as TOML reads it, with other values under some keys.

    A key is a path of names joined by dots; an entry of a list bears its sensor's name, its `name`, its `kind` where no other has it, or
    its place from 0. `sensors` alone takes names of those that stay. A number takes the place of one in degrees, and the other way.
    Raises InputError for a path that leads nowhere.
    """
    data = {key: value for key, value in tomllib.loads(scenario.source).items() if key not in _OF_THE_FILE}
    names = _entry_names(scenario, data)
    for key, value in values:
        if key == SENSORS:
            data[SENSORS] = _subset(value, data.get(SENSORS, []), names)
        else:
            _set(data, key, value, names)
    return data


def _plain(key: str, value: Any) -> Any:  # noqa: ANN401  # whatever a caller gave
    """Return the value as TOML would hold it: numbers of NumPy are numbers, tuples are lists."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, tuple | list):
        return [_plain(key, item) for item in value]
    if isinstance(value, Mapping):
        return {str(name): _plain(key, item) for name, item in value.items()}
    if not isinstance(value, bool | int | float | str) or (isinstance(value, float) and math.isnan(value)):
        raise InputError(f"vary[{key!r}] has {value!r}: must be numbers, texts, True or False, or lists and tables of them")
    return value


def _entry_names(scenario: Scenario, data: Mapping[str, Any]) -> list[str]:
    """Return the name of each entry of [[sensors]]: its own, or that of what it belongs to."""
    names = list(scenario.sensor_names)
    entries = data.get(SENSORS, [])
    if len(names) == len(entries):
        return names
    return [str(entry.get("group", entry.get("name", entry.get("kind", "")))) for entry in entries]


def _subset(wanted: Any, sensors: Sequence[Any], names: Sequence[str]) -> list[Any]:  # noqa: ANN401  # whatever a caller gave
    """Return the entries of [[sensors]] that are named."""
    if not isinstance(wanted, list) or not wanted:
        raise InputError(f"vary['{SENSORS}'] has {wanted!r}: must be lists of the sensors that stay, of {', '.join(names)}")
    require_known(f"vary['{SENSORS}']", wanted, names)
    return [sensor for sensor, name in zip(sensors, names, strict=True) if name in wanted]


def _set(data: dict[str, Any], key: str, value: Any, names: Sequence[str]) -> None:  # noqa: ANN401
    """Set the value under a dotted key, in place."""
    *path, last = key.split(".")
    table: Any = data
    for depth, part in enumerate(path):
        table = _entry(table, part, key, names if path[:depth] == [SENSORS] else ())
    if isinstance(table, list):
        table[_place(table, last, key, names if path == [SENSORS] else ())] = value
    elif isinstance(table, dict):
        table.pop(last.removesuffix(SUFFIX) if last.endswith(SUFFIX) else last + SUFFIX, None)
        table[last] = value
    else:
        raise InputError(f"vary[{key!r}]: {'.'.join(path)} is {table!r}, which has no keys")


def _entry(table: Any, part: str, key: str, names: Sequence[str]) -> Any:  # noqa: ANN401
    """Return what stands under one part of a key; a table that the file leaves out begins empty."""
    if isinstance(table, list):
        return table[_place(table, part, key, names)]
    if not isinstance(table, dict):
        raise InputError(f"vary[{key!r}]: {table!r} stands before {part!r}, which has no keys")
    return table.setdefault(part, {})


def _place(entries: Sequence[Any], part: str, key: str, names: Sequence[str]) -> int:
    """Return the place of an entry of a list by the sensor's name, its own name, its kind, or its number."""
    labels = list(names) or [str(entry.get("name", entry.get("kind", ""))) if isinstance(entry, dict) else "" for entry in entries]
    places = {label: i for i, label in enumerate(labels) if label and labels.count(label) == 1}
    places |= {str(i): i for i in range(len(entries))}
    require_known(f"vary[{key!r}]", [part], tuple(places))
    return places[part]
