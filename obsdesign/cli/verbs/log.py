"""`obsdesign log`: what is in a recorded run."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from obsdesign.cli.verb import QUIET, Argument, Outcome, Verb


def list_log(options: Namespace) -> Outcome:
    """Read a file of any format and list its topics and fields; raises InputError for what is none."""
    from obsdesign.logs.reading import read_recording

    recording = read_recording(options.file)
    document = {
        "file": str(recording.file),
        "format": recording.format,
        "epoch": recording.epoch,
        "topics": recording.table,
        "notes": list(recording.notes),
    }
    lines = [f"{recording.file}: {recording.format}, {len(recording.topics)} topics", *(_line(row) for row in recording.table)]
    return Outcome(document, (*lines, *recording.notes))


def _line(row: dict[str, object]) -> str:
    rate = "" if row["rate"] is None else f", {row['rate']:.4g} Hz, {row['first']:.6g} to {row['last']:.6g} s"
    fields = row["fields"]
    return f"  {row['topic']}: {row['messages']} messages{rate}: {', '.join(map(str, fields)) if isinstance(fields, list) else fields}"


VERB = Verb(
    name="log",
    what="list the topics and fields of a recorded run: CSV, NPZ, ULog, dataflash, ROS bag",
    action=list_log,
    example="log flight.ulg",
    arguments=(Argument("file", "the file, or the folder of a ROS 2 bag", read=Path, completes="files"), QUIET),
)
