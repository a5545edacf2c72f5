"""One run of a sweep: what names it, what is computed, and the file that holds the answer."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import obsdesign
from obsdesign.errors import ObsdesignError
from obsdesign.files import write_files
from obsdesign.report.document import SCHEMA_VERSION
from obsdesign.report.to_document import document_of
from obsdesign.scenario.loading import scenario_from_data
from obsdesign.study.runner import run
from obsdesign.sweeps.headline import headline

FOLDER = "runs"  # of the files, in that of the sweep


@dataclass(frozen=True)
class Task:
    """One scenario to be run: what its file would say, as JSON, what messages call that file, and the name of the run."""

    data: str
    file: str
    name: str


@dataclass(frozen=True)
class RunAnswer:
    """What became of a run: `text`, what its file holds (JSON), and that as data: `result` or `error`, the other None."""

    text: str

    @property
    def data(self) -> dict[str, Any]:
        """What the file holds."""
        return json.loads(self.text)


def task_of(data: Mapping[str, Any], file: str) -> Task:
    """Return the task of a scenario's data: its name is the sha256 of all that the answer depends on."""
    text = json.dumps(data, sort_keys=True, default=str)
    content = json.dumps({"scenario": text, "obsdesign": obsdesign.__version__, "schema": SCHEMA_VERSION})
    return Task(text, file, hashlib.sha256(content.encode()).hexdigest()[:32])


def compute(task: Task) -> RunAnswer:
    """Run one scenario in this process, and return its result, or the error that it ended with.

    Raises MemoryError and OSError: what a machine lacks is no answer to a scenario.
    """
    try:
        scenario = scenario_from_data(json.loads(task.data), task.file, task.name)
        outcome = {"error": None, "result": document_of(run(scenario)).model_dump(mode="json")}
    except (MemoryError, OSError):
        raise
    except Exception as error:  # noqa: BLE001  # whatever it is: it is this run's answer, and the others go on
        kind = "" if isinstance(error, ObsdesignError) else f"{type(error).__name__}: "
        outcome = {"error": f"{kind}{error}", "result": None}
    return RunAnswer(json.dumps({"name": task.name, "scenario": json.loads(task.data), **outcome}, allow_nan=False) + "\n")


def write_answer(folder: Path, name: str, answer: RunAnswer) -> None:
    """Write the file of a run: whole, or not at all."""
    write_files(folder / FOLDER, {f"{name}.json": answer.text})


def read_answer(folder: Path, task: Task) -> RunAnswer | None:
    """Return the answer of a task that has its file, None where it has none, or one of something else."""
    try:
        answer = RunAnswer((folder / FOLDER / f"{task.name}.json").read_text(encoding="utf-8"))
        data = answer.data
    except (OSError, ValueError, RecursionError):
        return None
    return answer if _is_of(data, task) else None


def _is_of(data: Any, task: Task) -> bool:  # noqa: ANN401  # whatever stands in a file
    """Whether that is the answer of a task: an error in words, or a result with every number of a table of runs."""
    if not isinstance(data, dict) or data.get("name") != task.name or data.get("scenario") != json.loads(task.data):
        return False
    if isinstance(data.get("error"), str):
        return data.get("result", "") is None
    try:
        headline(data["result"])
        return data["error"] is None
    except (KeyError, TypeError, AttributeError, ValueError):
        return False
