"""A sensor schedule as a table: one row per segment, 1 where a sensor is on."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from obsdesign.errors import InputError
from obsdesign.exchange.abstract import read_text
from obsdesign.exchange.track import SensorTimes


def schedule_csv(chosen: np.ndarray, sensors: Sequence[str], times: np.ndarray) -> str:
    """Return the schedule (K, S) of the named sensors; times (K+1,) [s]: where its segments begin and end."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["segment", "from [s]", "to [s]", *sensors])
    for k, row in enumerate(chosen.astype(int).tolist()):
        writer.writerow([k, float(times[k]), float(times[k + 1]), *row])
    return table.getvalue()


def read_schedule_csv(file: Path, sensors: Sequence[str]) -> SensorTimes:
    """Return the schedule of a file that `schedule_csv` wrote. Raises InputError for a file of another form or other sensors."""
    text = read_text(file)
    try:
        header, *rows = csv.reader(io.StringIO(text))
    except (ValueError, csv.Error) as error:
        raise InputError(f"{file}: cannot be read as a schedule: {error}") from None
    expected = ["segment", "from [s]", "to [s]", *sensors]
    if header != expected:
        raise InputError(f"{file}: has the columns {', '.join(header)}: must be {', '.join(expected)}")
    for number, row in enumerate(rows, 2):
        if len(row) != len(expected) or not {"0", "1"} >= set(row[3:]):
            raise InputError(f"{file}: line {number} is {','.join(row)!r}: must have {len(expected)} columns, 0 or 1 for each sensor")
    if not rows:
        raise InputError(f"{file}: has no segment")
    try:
        times = [float(row[1]) for row in rows] + [float(rows[-1][2])]
        return SensorTimes(tuple(sensors), np.array(times), np.array([[cell == "1" for cell in row[3:]] for row in rows]))
    except ValueError as error:  # a time that is none, or times that do not increase
        raise InputError(f"{file}: {error}") from None
