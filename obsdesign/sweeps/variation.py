"""The runs of a sweep: a scenario's keys, set to every combination of values."""

from __future__ import annotations

import json
import math
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations, product
from typing import Any

from obsdesign.checks import require_known
from obsdesign.errors import InputError, ScenarioError
from obsdesign.scenario.degrees import SUFFIX
from obsdesign.scenario.loading import scenario_from_data
from obsdesign.scenario.schema import Scenario

SENSORS = "sensors"  # the key whose values are subsets, named by their sensors
_OF_THE_FILE = ("sweep", "expected")  # keys that say nothing of what a run computes
_PlaceInData = tuple[str | int, ...]  # keys and places from the outermost table on
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
        counts = Counter(map(_identity, values))
        repeated = next((value for value in values if counts[_identity(value)] > 1), None)
        if not values or repeated is not None:
            raise InputError(f"vary[{key!r}] " + (f"has {repeated!r} twice" if values else "has no values: must have at least one"))
    return tuple(tuple(zip(columns, row, strict=True)) for row in product(*columns.values()))


def _identity(value: Any) -> Any:  # noqa: ANN401  # whatever TOML holds
    """What equal values share: 2 and 2.0, and tables whatever the order of their keys."""
    return value if isinstance(value, int | float) and not isinstance(value, bool) else json.dumps(value, sort_keys=True)


def varied_data(scenario: Scenario, values: Values) -> dict[str, Any]:
    """Return what the scenario's file says, as TOML reads it, with other values under some keys.

    A key is a path of names joined by dots; an entry of a list bears its sensor's name, its `name`, its `kind` where no other has it, or
    its place from 0. `sensors` alone takes names of those that stay. A number takes the place of one in degrees, and the other way.
    Which sensors stay is asked last, so that every key finds its own. Raises InputError for a path that leads nowhere, and for two that
    lead to one place.
    """
    data = {key: value for key, value in tomllib.loads(scenario.source).items() if key not in _OF_THE_FILE}
    names = _entry_names(scenario, data)
    _require_different_places({key: _set(data, key, value, names) for key, value in values if key != SENSORS})
    for _, wanted in (entry for entry in values if entry[0] == SENSORS):
        data[SENSORS] = _subset(wanted, data.get(SENSORS, []), names)
    return data


def accepted_data(scenario: Scenario, values: Values) -> dict[str, Any]:
    """Return `varied_data`, of which a scenario was made to see that it is one. Raises InputError where the scenario does not accept it."""
    data = varied_data(scenario, values)
    try:
        scenario_from_data(data, scenario.file, "")
    except ScenarioError as error:
        varied = ", ".join(f"{key} = {value!r}" for key, value in values)
        raise InputError(f"with {varied}: {error}") from None
    return data


def require_accepted(scenario: Scenario, vary: Mapping[str, Iterable[Any]]) -> None:
    """Raise InputError for a key, or a value beside the first ones of the other keys, that the scenario does not accept."""
    first, *others = combinations_of(vary)
    for values in (first, *(each for each in others if sum(a != b for a, b in zip(each, first, strict=True)) == 1)):
        accepted_data(scenario, values)


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
    if not isinstance(wanted, list) or not wanted or not all(isinstance(name, str) for name in wanted):
        raise InputError(f"vary['{SENSORS}'] has {wanted!r}: must be lists of the sensors that stay, of {', '.join(names)}")
    require_known(f"vary['{SENSORS}']", wanted, names)
    return [sensor for sensor, name in zip(sensors, names, strict=True) if name in wanted]


def _require_different_places(places: Mapping[str, _PlaceInData]) -> None:
    """Refuse keys of which one would undo, or change, what another one says."""
    for (key, place), (other, its_place) in combinations(places.items(), 2):
        shared = min(len(place), len(its_place))
        if place[:shared] == its_place[:shared]:
            raise InputError(f"vary has {key!r} and {other!r}, which lead to one place: must be keys of which none holds another one")


def _set(data: dict[str, Any], key: str, value: Any, names: Sequence[str]) -> _PlaceInData:  # noqa: ANN401
    """Set the value under a dotted key, in place; return where that is, a number in degrees where the number itself is."""
    *path, last = parts = key.split(".")
    if parts[0] in _OF_THE_FILE:
        raise InputError(f"vary[{key!r}]: must be a key that changes what is computed")
    table, place = data, []
    for depth, part in enumerate(path):
        place.append(_key_in(table, part, key, depth, names if path[:depth] == [SENSORS] else ()))
        table = table.setdefault(part, {}) if isinstance(table, dict) else table[place[-1]]
    end = _key_in(table, last, key, len(path), names if path == [SENSORS] else ())
    if isinstance(table, dict):
        table.pop(last.removesuffix(SUFFIX) if last.endswith(SUFFIX) else last + SUFFIX, None)
    table[end] = value
    return (*place, end.removesuffix(SUFFIX) if isinstance(end, str) else end)


def _key_in(table: Any, part: str, key: str, depth: int, names: Sequence[str]) -> Any:  # noqa: ANN401
    """Return under what a table, or a list, has one part of a key, the one at a depth."""
    if isinstance(table, list):
        return _place(table, part, key, names)
    if not isinstance(table, dict):
        raise InputError(f"vary[{key!r}]: {'.'.join(key.split('.')[:depth])} is {table!r}, which has no keys")
    return part


def _place(entries: Sequence[Any], part: str, key: str, names: Sequence[str]) -> int:
    """Return the place of an entry of a list by the sensor's name, its own name, its kind, or its number."""
    labels = list(names) or [str(entry.get("name", entry.get("kind", ""))) if isinstance(entry, dict) else "" for entry in entries]
    places = {label: i for i, label in enumerate(labels) if label and labels.count(label) == 1}
    places |= {str(i): i for i in range(len(entries))}
    require_known(f"vary[{key!r}]", [part], tuple(places))
    return places[part]
