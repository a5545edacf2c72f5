"""A scenario for a log: what the log itself tells need not be said, and one sensor may stand for many landmarks."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from obsdesign.errors import InputError

Landmarks = Mapping[str, tuple[float, ...]]
_NOWHERE = 0.123456789  # of a start that nobody gave: no landmark stands there
ANY_LANDMARK: Landmarks = {"landmark": (1.123456789, 0.123456789)}  # stands for those of a table that is not at hand
_SEGMENT = 10.0  # s
_STEPS = 20  # of a segment
_HEADER = ("name", "x", "y")
OF_LANDMARKS = ("range", "bearing", "range_bearing", "doppler")  # kinds of sensors that stand for one at each landmark


def with_log_defaults(data: dict[str, Any], landmarks: Landmarks) -> dict[str, Any]:
    """Return the TOML data with a title, question, start and time where there are none, and a sensor for each landmark.

    A sensor that has no `beacon` stands for one at each landmark, named after it, behind its own name where it has one. Rates are left
    out: the log says when samples came.
    """
    time = data.get("time", {})
    segment = time.get("segment", _SEGMENT) if isinstance(time, Mapping) else _SEGMENT
    length = float(segment) if isinstance(segment, (int, float)) else _SEGMENT
    spans = {"duration": length, "step": length / _STEPS, "segment": length}
    prior = data.get("prior")
    start = dict.fromkeys(prior, _NOWHERE) if isinstance(prior, Mapping) else {}
    defaults = {"title": "A log", "question": "What does the log say?", "start": start}
    result = defaults | data | ({"time": spans | dict(time)} if isinstance(time, Mapping) else {})
    sensors = data.get("sensors")
    if isinstance(sensors, list):
        result["sensors"] = [copy for sensor in sensors for copy in _copies(sensor, landmarks)]
    return result


def _copies(sensor: Any, landmarks: Landmarks) -> list[Any]:  # noqa: ANN401  # whatever TOML can hold
    if not isinstance(sensor, Mapping):
        return [sensor]
    own = {key: value for key, value in sensor.items() if key != "rate"}
    if not landmarks or not is_of_landmarks(sensor):
        return [own]
    return [own | _at(own.get("name"), name, place) for name, place in landmarks.items()]


def is_of_landmarks(sensor: Any) -> bool:  # noqa: ANN401
    """Whether a sensor's table stands for one at each landmark."""
    return isinstance(sensor, Mapping) and "beacon" not in sensor and sensor.get("kind") in OF_LANDMARKS


def _at(own_name: Any, name: str, place: tuple[float, ...]) -> dict[str, Any]:  # noqa: ANN401
    height = {"height": place[2]} if len(place) > 2 else {}
    return {"name": f"{own_name}_{name}" if own_name else name, "beacon": list(place[:2]), **height}


def read_landmarks(file: Path) -> dict[str, tuple[float, ...]]:
    """Return the landmarks of a CSV table with columns name, x, y and perhaps height [m].

    Raises InputError, naming file, line and column, for what cannot be read.
    """
    try:
        with file.open(newline="", encoding="utf-8") as lines:
            rows = [(number, row) for number, row in enumerate(csv.reader(lines), 1) if any(cell.strip() for cell in row)]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: cannot be read: {error}") from None
    header = [cell.partition("[")[0].strip() for cell in rows[0][1]] if rows else []
    if tuple(header[:3]) != _HEADER or header[3:] not in ([], ["height"]):
        raise InputError(f"{file}, line 1: the columns are {', '.join(header) or 'none'}: must be name, x, y, and height where it is known")
    landmarks: dict[str, tuple[float, ...]] = {}
    for number, row in rows[1:]:
        if len(row) != len(header):
            raise InputError(f"{file}, line {number}: has {len(row)} cells: must be {len(header)}")
        if row[0].strip() in landmarks:
            raise InputError(f"{file}, line {number}, column 'name': {row[0].strip()!r} stands there twice")
        landmarks[row[0].strip()] = tuple(_number(file, number, column, cell) for column, cell in zip(header[1:], row[1:], strict=True))
    return landmarks


def _number(file: Path, line: int, column: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if not abs(value) < float("inf"):
        raise InputError(f"{file}, line {line}, column {column!r}: {cell!r} is no finite number of metres")
    return value
