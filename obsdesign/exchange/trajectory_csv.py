"""A path as a table: time, states, inputs, with units in the header."""

from __future__ import annotations

import csv
import io

import numpy as np

from obsdesign.model import AbstractSystem
from obsdesign.trajectory import Trajectory


def trajectory_csv(system: AbstractSystem, path: Trajectory) -> str:
    """Return one row per node at full precision; the inputs of a row hold until the next one, so the last row has none.

    Unknown inputs stand last, if the path tells them.
    """
    model = system.model
    signals = (*model.states, *model.inputs, *(() if path.w is None else model.unknown_inputs))
    held = path.u if path.w is None else np.hstack([path.u, path.w])
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["t [s]", *(f"{signal.name} [{signal.unit or '-'}]" for signal in signals)])
    for t, x, inputs in zip(path.t.tolist(), path.x.tolist(), [*held.tolist(), [""] * held.shape[1]], strict=True):
        writer.writerow([t, *x, *inputs])
    return table.getvalue()
