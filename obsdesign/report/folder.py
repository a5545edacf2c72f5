"""Writing a study's results: all files or none."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from obsdesign.arguments import validate_arguments
from obsdesign.errors import InputError
from obsdesign.exchange.schedule_csv import schedule_csv
from obsdesign.exchange.trajectory_csv import trajectory_csv
from obsdesign.files import write_files
from obsdesign.report.derived_quantities import segment_nodes
from obsdesign.report.document import SCHEMA_VERSION, Result
from obsdesign.report.document_parts import as_json
from obsdesign.report.html import page_of
from obsdesign.report.study_record import study_of
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


@validate_arguments
def load_study(file: str | Path) -> Study:
    """Return the study of an earlier run, every number to the last bit; runs no code of the file.

    Arguments:
        file: result.json, or the folder that it is in.
    Raises InputError for a file that cannot be read, is no result, or holds no record of its study.
    """
    return study_of(read_result(Path(file)), file)


def read_result(file: Path) -> Result:
    """Return the document of an earlier run from result.json, or the folder that it is in. Raises InputError where there is none."""
    file = file / "result.json" if file.is_dir() else file
    try:
        return Result.model_validate_json(file.read_bytes())
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        reason = f"{where + ': ' if where else ''}{first['msg']}"
        raise InputError(f"{file}: is no result of this version of obsdesign (schema {SCHEMA_VERSION}): {reason}") from None


def write_page(folder: Path, result: Result, study: Study) -> None:
    """Write report.html of an earlier run again."""
    write_files(folder, {"report.html": page_of(study, result.versions)})
