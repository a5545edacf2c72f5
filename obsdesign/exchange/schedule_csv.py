"""A sensor schedule as a table: one row per segment, 1 where a sensor is on."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import numpy as np


def schedule_csv(chosen: np.ndarray, sensors: Sequence[str], times: np.ndarray) -> str:
    """Return the schedule (K, S) of the named sensors; times (K+1,) [s]: where its segments begin and end."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["segment", "from [s]", "to [s]", *sensors])
    for k, row in enumerate(chosen.astype(int).tolist()):
        writer.writerow([k, float(times[k]), float(times[k + 1]), *row])
    return table.getvalue()
