"""Reading a scenario file, and saying all that is wrong with it."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from obsdesign.arguments import validate_arguments
from obsdesign.errors import ScenarioError
from obsdesign.scenario.analysis_defaults import with_analysis_defaults
from obsdesign.scenario.contradictions import find_contradictions
from obsdesign.scenario.degrees import SUFFIX, non_angles, scenario_in_radians
from obsdesign.scenario.key_lines import line_of
from obsdesign.scenario.kind_tables import COST, leaf_of
from obsdesign.scenario.log_defaults import Landmarks, with_log_defaults
from obsdesign.scenario.problem_text import (
    Location,
    Problem,
    describe_error,
    in_file,
    location_text,
    of_a_part,
    of_another_type,
    unknown_key,
    value_at,
)
from obsdesign.scenario.schema import Scenario
from obsdesign.scenario.sizes import too_large
from obsdesign.scenario.upgrades import upgrade_data

_INTERNAL_FIELDS = ("file", "digest", "source")  # fields of the record that are no keys of the file


@validate_arguments
def load_scenario(file: str | Path) -> Scenario:
    """Read and check a scenario; runs no code and starts no solver.

    Arguments:
        file: path of a TOML file.
    Raises ScenarioError for a file that cannot be read, for TOML that is none (line and column), and for every key that is
    unknown, missing or has a value that is not accepted: all of them in one message.
    """
    return _load(Path(file), _Use())


@dataclass(frozen=True)
class _Use:
    """What a scenario is read for: a path that stands in a file of its own; a log, with its landmarks by name; verdicts alone."""

    has_path: bool = False
    landmarks: Landmarks | None = None
    has_verdicts_alone: bool = False


def load_scenario_of_path(file: Path) -> Scenario:
    """Read and check a scenario for a path that stands in a file of its own, so that no [design] is needed; see load_scenario."""
    return _load(file, _Use(has_path=True))


def load_scenario_of_log(file: Path, landmarks: Landmarks) -> Scenario:
    """Read and check a scenario for a log: no [design], [start] and [time] are needed; see load_scenario.

    landmarks: places by name, for sensors without a beacon of their own.
    """
    return _load(file, _Use(has_path=True, landmarks=landmarks))


def load_scenario_to_analyse(file: Path, landmarks: Landmarks | None = None) -> Scenario:
    """Read and check a scenario of which verdicts alone are asked: no [design], [start], [prior], [time] are needed; see load_scenario.

    landmarks: places by name, for sensors without a beacon of their own.
    """
    return _load(file, _Use(has_path=True, landmarks=landmarks, has_verdicts_alone=True))


def scenario_from_text(text: str, file: str) -> Scenario:
    """Check the text of a scenario, for its own paths or for others; `file`: what messages call it. See load_scenario."""
    return _parse(text, Path(file), _Use(has_path=True))


def scenario_from_data(data: dict[str, Any], file: str, digest: str) -> Scenario:
    """Check what TOML read of a scenario, of which some values were set since; it has no text. See load_scenario.

    digest: what stands for the sha256 of its file.
    """
    return _check(data, {"file": file, "digest": digest, "source": ""}, _Use())


def _load(file: Path, use: _Use) -> Scenario:
    try:
        text = file.read_bytes().decode()
    except OSError as error:
        raise ScenarioError(f"{file}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{file}: is not UTF-8 text (byte {error.start})") from None
    return _parse(text, file, use)


def _parse(text: str, file: Path, use: _Use) -> Scenario:
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{file}: not valid TOML: {error}") from None
    return _check(data, {"file": str(file), "digest": hashlib.sha256(text.encode()).hexdigest(), "source": text}, use)


def _check(data: dict[str, Any], internal: dict[str, str], use: _Use) -> Scenario:
    """Return the scenario of TOML data; internal: what the record says of its file. Raises ScenarioError with all that is wrong.

    Of a file that has [analysis], no [start] and no [replay] verdicts alone are asked, whoever reads it.
    """
    has_log = use.landmarks is not None or "replay" in data
    has_verdicts_alone = use.has_verdicts_alone or ("analysis" in data and "start" not in data and not has_log)
    completed = with_analysis_defaults(data) if has_verdicts_alone else data
    upgrade = upgrade_data(with_log_defaults(completed, use.landmarks or {}) if has_log else completed)
    reserved_keys = [unknown_key((key,), key, _keys_at(())) for key in _INTERNAL_FIELDS if key in data]
    scenario, problems = _validate(upgrade.data, internal, use.has_path or has_log or has_verdicts_alone, has_verdicts_alone)
    problems = [*upgrade.problems, *reserved_keys, *problems]
    if scenario is None or problems:
        raise _error(Path(internal["file"]), internal["source"], data, problems)
    return scenario


def _error(file: Path, text: str, data: dict[str, Any], problems: Sequence[Problem]) -> ScenarioError:
    """Return the error that tells of all problems, each with its line."""
    lines = [line_of(text, problem.location) for problem in problems]
    count = "" if len(problems) == 1 else f" {len(problems)} problems"
    told = (f"\n  {problem}" if line is None else f"\n  line {line}: {problem}" for line, problem in zip(lines, problems, strict=True))
    return ScenarioError(
        f"{file}:{count}" + "".join(told),
        tuple(
            {
                "line": line,
                "key": location_text(problem.location),
                "value": value_at(data, problem.location),
                "message": problem.message,
                "accepted": list(problem.accepted),
                "nearest": problem.nearest,
            }
            for line, problem in zip(lines, problems, strict=True)
        ),
    )


def _validate(
    data: dict[str, Any], internal: dict[str, str], has_path: bool, has_verdicts_alone: bool
) -> tuple[Scenario | None, list[Problem]]:
    oversized = list(too_large(data))
    if oversized:
        return None, oversized
    try:
        # strict JSON mode: arrays become tuples, nothing else is converted
        text = json.dumps({**scenario_in_radians(data), **_as_written(data), **internal}, default=str)
        scenario = Scenario.model_validate_json(text)
    except ValidationError as error:
        told = [detail for detail in error.errors() if not (of_another_type(detail, data) or of_a_part(detail, data))]
        return None, [describe_error(detail, data, _keys_at) for detail in told]
    wrong = [Problem(location, _no_angle_message(location)) for location in non_angles({**data, "sweep": {}}, scenario)]
    contradictions = [
        replace(problem, location=in_file(problem.location, data))
        for problem in find_contradictions(scenario, has_path, has_verdicts_alone)
    ]
    return scenario, wrong + contradictions


def _as_written(data: dict[str, Any]) -> dict[str, Any]:
    """Return the tables whose keys are those of others: in which unit, that they say themselves."""
    return {key: data[key] for key in ("sweep",) if key in data}


def _no_angle_message(location: Location) -> str:
    written = str(location[-1]).removesuffix(SUFFIX)
    if location[0] == "place" and written in ("latitude", "longitude"):
        return f"{written} is in degrees by itself: write {written}"
    return "is given in degrees: is no angle"


def _keys_at(location: Location) -> Sequence[str]:
    """Keys that the table at a location accepts."""
    table: Any = Scenario
    beside: list[str] = []
    for part in location:
        if (named := leaf_of(part)) is not None:
            table = named
        elif not isinstance(part, int) and isinstance(table, type) and issubclass(table, BaseModel) and part in _fields_of(table):
            beside = [key for key in table.model_fields if key != COST] if part == COST else []
            table = _table_in(_fields_of(table)[part])
    if is_dataclass(table):
        return ("kind", *(field.name for field in fields(table)), *beside)
    return (
        [key for key in _fields_of(table) if key not in _INTERNAL_FIELDS]
        if isinstance(table, type) and issubclass(table, BaseModel)
        else ()
    )


def _fields_of(table: type[BaseModel]) -> dict[str, Any]:
    """Key of the file -> annotation."""
    return {field.alias or name: field.annotation for name, field in table.model_fields.items()}


def _table_in(annotation: Any) -> Any:  # noqa: ANN401
    """The model inside an annotation such as tuple[Model, ...]."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inner = [model for part in get_args(annotation) if isinstance(model := _table_in(part), type) and issubclass(model, BaseModel)]
    return inner[0] if inner else annotation
