"""PX4's ULog, by pyulog."""

from __future__ import annotations

from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np

from obsdesign.errors import InputError
from obsdesign.logs.recording import Recording, Topic, missing_package


def read_ulog(file: Path) -> Recording:
    """Return the topics of a ULog, the second and later instances of one numbered: "sensor_gps[1]". Times are since the autopilot began.

    Raises InputError for a file that is none, MissingPackageError where pyulog is not installed.
    """
    try:
        from pyulog import ULog
    except ImportError:
        raise missing_package("pyulog", "px4", "ULog") from None
    try:
        with file.open("rb") as opened, redirect_stdout(StringIO()):  # it prints what it thinks of a file
            log = ULog(opened)
    except Exception as error:  # noqa: BLE001  # whatever it makes of a broken file
        raise InputError(f"{file}: is no ULog that can be read: {error}") from None
    topics = {}
    timed = [data for data in log.data_list if "timestamp" in data.data]
    for data in sorted(timed, key=lambda data: (data.name, data.multi_id)):
        name = data.name if data.multi_id == 0 else f"{data.name}[{data.multi_id}]"
        fields = {key: np.asarray(values, dtype=float) for key, values in data.data.items() if key != "timestamp"}
        topics[name] = Topic(name, np.asarray(data.data["timestamp"], dtype=float) * 1e-6, fields)
    notes = [f"{len(log.dropouts)} dropouts of the logger"] if log.dropouts else []
    if log.file_corruption:
        notes.append("the file is damaged: what could be read of it is there")
    if not topics:
        raise InputError(f"{file}: is a ULog without a topic that has times")
    return Recording(file, "PX4 ULog", topics, notes=tuple(notes))
