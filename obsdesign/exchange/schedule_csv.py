"""A sensor schedule as a table: one row per segment, 1 where a sensor is on."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import numpy as np


def schedule_csv(chosen: np.ndarray, sensors: Sequence[str], segment: float) -> str:
    """Return the schedule (K, S) of the named sensors; segment: its length [s]."""
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["segment", "from [s]", "to [s]", *sensors])
    for k, row in enumerate(chosen.astype(int).tolist()):
        writer.writerow([k, k * segment, (k + 1) * segment, *row])
    return table.getvalue()
