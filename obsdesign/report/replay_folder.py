"""Writing what a log says: all files or none."""

from __future__ import annotations

from pathlib import Path

from obsdesign.exchange.schedule_csv import schedule_csv
from obsdesign.files import write_files
from obsdesign.report.document_parts import as_json
from obsdesign.report.replay_document import LogSchedulePart, ReplayDocument
from obsdesign.report.replay_page import replay_page
from obsdesign.study.log_study import LogStudy


def write_replay(folder: Path, study: LogStudy, document: ReplayDocument) -> None:
    """Write report.html and replay.json, under temporary names that are renamed at the end.

    Raises InputError for a folder that cannot be written.
    """
    write_files(folder, {"report.html": replay_page(study), "replay.json": as_json(document)})


def write_log_schedule(folder: Path, study: LogStudy, part: LogSchedulePart | None) -> None:
    """Write schedule.csv and schedule.json of a log; raise InputError for a folder that cannot be written."""
    schedule = study.schedule
    if schedule is None or part is None:
        return
    table = schedule_csv(schedule.chosen, schedule.sensors, schedule.boundaries)
    write_files(folder, {"schedule.csv": table, "schedule.json": as_json(part)})
