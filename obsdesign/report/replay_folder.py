"""Writing what a log says: all files or none."""

from __future__ import annotations

import json
from pathlib import Path

from obsdesign.files import write_files
from obsdesign.report.replay_document import ReplayDocument
from obsdesign.report.replay_page import replay_page
from obsdesign.study.log_study import LogStudy


def write_replay(folder: Path, study: LogStudy, document: ReplayDocument) -> None:
    """Write report.html and replay.json, under temporary names that are renamed at the end.

    Raises InputError for a folder that cannot be written.
    """
    text = json.dumps(document.model_dump(mode="json"), indent=1, allow_nan=False) + "\n"
    write_files(folder, {"report.html": replay_page(study), "replay.json": text})
