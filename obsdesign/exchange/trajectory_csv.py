"""A path as a table: time, states, inputs, with units in the header."""

from __future__ import annotations

import csv
import io

from obsdesign.model import AbstractSystem
from obsdesign.trajectory import Trajectory


def trajectory_csv(system: AbstractSystem, path: Trajectory) -> str:
    """Return one row per node at full precision; the inputs of a row hold until the next one, so the last row has none."""
    model = system.model
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["t [s]", *(f"{signal.name} [{signal.unit or '-'}]" for signal in (*model.states, *model.inputs))])
    for k, (t, x) in enumerate(zip(path.t.tolist(), path.x.tolist(), strict=True)):
        u = path.u[k].tolist() if k < path.steps else [""] * path.u.shape[1]
        writer.writerow([t, *x, *u])
    return table.getvalue()
