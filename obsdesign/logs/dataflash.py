"""ArduPilot's dataflash logs, binary and text, by pymavlink."""

from __future__ import annotations

from collections import defaultdict
from contextlib import closing, redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np

from obsdesign.errors import InputError
from obsdesign.logs.recording import Recording, Topic, missing_package


def read_dataflash(file: Path) -> Recording:
    """Return the messages of a dataflash log by kind, those of several instances by "GPS[1]". Times are TimeUS, since the autopilot began.

    Numbers are as pymavlink gives them: of a binary log latitudes are degrees, of a text log what the text says. Its dates are not used.
    Raises InputError for a file that is none, MissingPackageError where pymavlink is not installed.
    """
    try:
        from pymavlink import DFReader
    except ImportError:
        raise missing_package("pymavlink", "ardupilot", "dataflash") from None
    try:
        is_text = file.suffix.lower() == ".log"
        # it prints what it thinks of a file
        with (
            redirect_stdout(StringIO()),
            closing(DFReader.DFReader_text(str(file)) if is_text else DFReader.DFReader_binary(str(file))) as reader,
        ):
            messages = _messages(reader)
    except Exception as error:  # noqa: BLE001  # whatever it makes of a broken file
        raise InputError(f"{file}: is no dataflash log that can be read: {error}") from None
    if not messages:
        raise InputError(f"{file}: has no message with a time (TimeUS)")
    return Recording(file, "ArduPilot dataflash", {name: _topic(name, rows) for name, rows in messages.items()})


def _messages(reader: object) -> dict[str, list[dict[str, float]]]:
    """Return the numbers of all messages that have a time."""
    found: dict[str, list[dict[str, float]]] = defaultdict(list)
    while (message := reader.recv_msg()) is not None:  # pyright: ignore[reportAttributeAccessIssue]
        values = message.to_dict()
        row = {name: float(value) for name, value in values.items() if isinstance(value, int | float)}
        if "TimeUS" in row:
            instance = values.get("I", 0)
            # a fraction is no number of an instance but what a controller has integrated
            is_first = not isinstance(instance, int) or instance == 0
            found[message.get_type() if is_first else f"{message.get_type()}[{instance}]"].append(row)
    return dict(found)


def _topic(name: str, rows: list[dict[str, float]]) -> Topic:
    fields = {key: np.array([row.get(key, np.nan) for row in rows]) for key in rows[0] if key != "TimeUS"}
    return Topic(name, np.array([row["TimeUS"] for row in rows]) * 1e-6, fields)
