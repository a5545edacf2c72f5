"""Writing a study's results: all files or none."""

from __future__ import annotations

import json
from pathlib import Path

from obsdesign.arguments import validate_arguments
from obsdesign.exchange.schedule_csv import schedule_csv
from obsdesign.exchange.trajectory_csv import trajectory_csv
from obsdesign.files import write_files
from obsdesign.report.derived_quantities import segment_nodes
from obsdesign.report.document import Result
from obsdesign.report.html import page_of
from obsdesign.report.to_document import document_of
from obsdesign.study.record import Study


@validate_arguments
def write_report(folder: str | Path, study: Study) -> Result:
    """Write report.html, result.json, trajectory.csv and schedule.csv of a study; return what result.json holds.

    question.toml is what the scenario's file said, where it was read from one: what exports of the folder start from. Everything is
    written under temporary names in the folder and renamed at the end.

    Arguments:
        folder: where to write; it is made where there is none.
        study: the study, as run returns it.
    Raises InputError for a folder that cannot be written.
    """
    result = document_of(study)
    contents = {
        "report.html": page_of(study),
        "result.json": as_json(result),
        "trajectory.csv": trajectory_csv(study.scenario.system, study.main.path),
        "schedule.csv": schedule_csv(study.selection.chosen, study.scenario.sensor_names, segment_nodes(study)),
    }
    if study.scenario.source:
        contents["question.toml"] = study.scenario.source
    write_files(Path(folder), contents)
    return result


def as_json(result: Result) -> str:
    """Return the document as text: numbers at full precision, the same order every time."""
    return json.dumps(result.model_dump(mode="json"), indent=1, allow_nan=False) + "\n"
