"""A TOML file that says which topics and fields of a recording are inputs, sensors and truth of a system."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from obsdesign.calculus import yaw
from obsdesign.checks import require_known
from obsdesign.dynamics.model import Model
from obsdesign.errors import InputError
from obsdesign.geodesy import TangentPlane
from obsdesign.logs.csv_tables import signals_of
from obsdesign.logs.recording import Recording, Topic
from obsdesign.logs.series import TRUTH, FileContents, Series
from obsdesign.logs.units import factor_of
from obsdesign.signals import Signal

_TABLES = ("inputs", "sensors", "truth", "origin")
_KEYS = (
    "topic",
    "field",
    "fields",
    "weights",
    "unit",
    "factor",
    "offset",
    "increment",
    "geodetic",
    "compass",
    "quaternion",
    "sigma",
    "where",
)
_DEGREES = {"": 1.0, "deg": 1.0, "1e-7 deg": 1e-7, "rad": 180 / np.pi}


@dataclass(frozen=True)
class TopicMap:
    """Which fields are what, by the names of a log; origin of geodetic positions, None = the first of them."""

    file: Path
    entries: Mapping[str, Mapping[str, Any]]
    origin: TangentPlane | None


def load_topic_map(file: Path) -> TopicMap:
    """Read a map; raise InputError that names the key which is not accepted."""
    try:
        document = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: is no TOML: {error}") from None
    require_known(f"{file}", list(document), _TABLES)
    entries: dict[str, Mapping[str, Any]] = {}
    for table, prefix in (("inputs", ""), ("sensors", ""), ("truth", TRUTH)):
        for name, entry in document.get(table, {}).items():
            if not isinstance(entry, dict):
                raise InputError(f"{file}: {table}.{name} is {entry!r}: must be a table with topic and field")
            require_known(f"{file}: {table}.{name}", list(entry), _KEYS)
            entries[prefix + name] = entry
    return TopicMap(file, entries, _origin(file, document.get("origin")))


def _origin(file: Path, table: Any) -> TangentPlane | None:  # noqa: ANN401  # what TOML may hold
    if table is None:
        return None
    require_known(f"{file}: origin", list(table), ("latitude", "longitude"))
    try:
        origin = TangentPlane(float(table["latitude"]), float(table["longitude"]))
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{file}: origin is {table!r}: must be latitude and longitude [deg]") from None
    _require_degrees(f"{file}: origin", np.array([origin.latitude]), np.array([origin.longitude]))
    return origin


def map_topics(recording: Recording, topic_map: TopicMap, model: Model) -> FileContents:
    """Return the series that a map picks from a recording; raise InputError for topics and fields that are not there."""
    origin = topic_map.origin or _first_position(recording, topic_map)
    series = [part for name, entry in topic_map.entries.items() for part in _series(recording, topic_map, model, name, entry, origin)]
    notes = (*recording.notes, *((origin.note,) if origin is not None else ()))
    return FileContents(recording.file, tuple(series), recording.epoch, notes)


def _first_position(recording: Recording, topic_map: TopicMap) -> TangentPlane | None:
    for name, entry in topic_map.entries.items():
        if entry.get("geodetic"):
            picked = _pick(recording, topic_map, name, entry)
            latitude, longitude = (float(column[0]) for column in _geodetic(topic_map, name, entry, picked))
            return TangentPlane(latitude, longitude)
    return None


@dataclass(frozen=True, eq=False)
class _Picked:
    """Rows of a topic: their numbers, times, and the columns of the fields asked for."""

    rows: np.ndarray
    t: np.ndarray
    columns: Sequence[np.ndarray]
    sigma: np.ndarray | None
    where: str


def _pick(recording: Recording, topic_map: TopicMap, name: str, entry: Mapping[str, Any]) -> _Picked:
    place = f"{topic_map.file}: {name}"
    fields = entry.get("fields", [entry.get("field")])
    if "topic" not in entry or not all(isinstance(key, str) for key in fields):
        raise InputError(f"{place}: needs topic and field, or fields: a list of texts")
    topic = recording.topic(entry["topic"])
    names = [*fields, *([entry["sigma"]] if "sigma" in entry else []), *entry.get("where", {})]
    require_known(f"{place}: topic {topic.name!r} of {recording.file}", names, list(topic.fields))
    chosen = _chosen(topic, entry.get("where", {}), [topic.fields[key] for key in fields])
    if not len(chosen):
        raise InputError(f"{place}: topic {topic.name!r} of {recording.file} has no message with these fields")
    sigma = topic.fields[entry["sigma"]][chosen] if "sigma" in entry else None
    columns = [topic.fields[key][chosen] for key in fields]
    rows = chosen + 1 if topic.rows is None else topic.rows[chosen]
    return _Picked(rows, topic.t[chosen], columns, sigma, f"{topic.name}.{'/'.join(fields)}")


def _chosen(topic: Topic, where: Mapping[str, float], columns: Sequence[np.ndarray]) -> np.ndarray:
    """Rows where fields have the values asked for, and numbers stand in the columns: bags have nan for what a message lacks."""
    is_chosen = np.isfinite(np.column_stack(columns)).all(axis=1)
    for key, value in where.items():
        is_chosen &= topic.fields[key] == value
    return np.flatnonzero(is_chosen)


def _series(
    recording: Recording, topic_map: TopicMap, model: Model, name: str, entry: Mapping[str, Any], origin: TangentPlane | None
) -> list[Series]:
    picked = _pick(recording, topic_map, name, entry)
    place, is_increment = f"{topic_map.file}: {name}", bool(entry.get("increment", False))
    values, sigma = _values(topic_map, name, entry, picked, origin), picked.sigma
    names = [name]
    if name == TRUTH + "position":
        names = [TRUTH + "x", TRUTH + "y"]
    signals = signals_of(model)
    if not entry.get("geodetic") and names[0] in signals:
        signal = signals[names[0]]
        unit = signal.unit.removesuffix("/s") if is_increment else signal.unit
        scale = factor_of(place, Signal(name, unit, signal.is_angle), str(entry.get("unit", ""))) * float(entry.get("factor", 1.0))
        values, sigma = values * scale, None if sigma is None else sigma * abs(scale)
    else:
        values = values * float(entry.get("factor", 1.0))
    values = values + float(entry.get("offset", 0.0))
    if entry.get("compass"):  # clockwise from north -> counter-clockwise from east
        values = np.pi / 2 - values
    parts = [values] if len(names) == 1 else [values[:, [i]] for i in range(len(names))]
    return [
        Series(part_name, picked.t, part, picked.where, picked.rows, recording.row_word, sigma, is_increment)
        for part_name, part in zip(names, parts, strict=True)
    ]


def _values(topic_map: TopicMap, name: str, entry: Mapping[str, Any], picked: _Picked, origin: TangentPlane | None) -> np.ndarray:
    """Return the numbers (K, c): metres of geodetic positions, yaw [rad] of quaternions (w, x, y, z), else as they are."""
    place = f"{topic_map.file}: {name}"
    if entry.get("geodetic"):
        return _metres(f"{place} ({picked.where})", *_geodetic(topic_map, name, entry, picked), origin)
    if entry.get("quaternion"):
        if len(picked.columns) != 4:
            raise InputError(f"{place}: quaternion needs four fields, w, x, y, z")
        w, x, y, z = picked.columns
        return np.unwrap(yaw(x, y, z, w))[:, None]
    values = np.column_stack(picked.columns)
    if "weights" not in entry:
        return values
    weights = entry["weights"]
    if not (isinstance(weights, list) and len(weights) == values.shape[1] and all(isinstance(w, int | float) for w in weights)):
        raise InputError(f"{place}: weights is {weights!r}: must be a number for each of the {values.shape[1]} fields")
    return (values @ np.array(weights, dtype=float))[:, None]


def _geodetic(topic_map: TopicMap, name: str, entry: Mapping[str, Any], picked: _Picked) -> tuple[np.ndarray, np.ndarray]:
    unit = str(entry.get("unit", ""))
    if unit not in _DEGREES or len(picked.columns) != 2:
        raise InputError(
            f"{topic_map.file}: {name}: geodetic needs two fields, latitude and longitude, in deg, 1e-7 deg or rad; it has {unit!r}"
        )
    latitude, longitude = (column * _DEGREES[unit] for column in picked.columns)
    return latitude, longitude


def _metres(where: str, latitude: np.ndarray, longitude: np.ndarray, origin: TangentPlane | None) -> np.ndarray:
    """Metres east and north (K, 2) of an origin, the first position where there is none."""
    _require_degrees(where, latitude, longitude)
    plane = TangentPlane(float(latitude[0]), float(longitude[0])) if origin is None else origin
    try:
        return plane.to_metres(latitude, longitude)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _require_degrees(where: str, latitude: np.ndarray, longitude: np.ndarray) -> None:
    for name, values, limit in (("latitude", latitude, 90.0), ("longitude", longitude, 360.0)):
        wrong = values[~(np.abs(values) <= limit)]
        if wrong.size:
            raise InputError(f'{where}: {name} {wrong[0]:g} deg is beyond {limit:g}: is it in another unit? (unit = "1e-7 deg")')
