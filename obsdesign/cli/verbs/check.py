"""`obsdesign check`: what is wrong with a scenario."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from obsdesign.cli.folders import scenario_file
from obsdesign.cli.verb import LANDMARKS, QUIET, SCENARIO, Outcome, Verb

if TYPE_CHECKING:
    from obsdesign.scenario.schema import Scenario


def check(options: Namespace) -> Outcome:
    """Read a scenario; raises ScenarioError that says all that is wrong with it."""
    import tomllib

    from obsdesign.scenario.upgrades import upgrade_data

    file = scenario_file(options.scenario)
    scenario, is_of_log, notes = _read(file, options.landmarks)
    if scenario.sweep is not None and not is_of_log:
        from obsdesign.sweeps.variation import require_accepted

        require_accepted(scenario, scenario.sweep.vary)
    changes = upgrade_data(tomllib.loads(scenario.source)).changes
    lasts = "for a log" if is_of_log else f"{scenario.segments} segments"
    what = f"{scenario.title}: {len(scenario.state_names)} states, sensors {', '.join(scenario.sensor_names)}, {lasts}"
    document = {"file": str(file), "title": scenario.title, "ok": True, "upgraded": list(changes)}
    return Outcome(document, (f"{file}: fine ({what})", *notes, *_upgrade_lines(changes)))


def _read(file: Path, landmarks: Path | None) -> tuple[Scenario, bool, tuple[str, ...]]:
    """Return a scenario, whether it is one for a log, and what to know of its landmarks."""
    from obsdesign.scenario.loading import load_scenario, load_scenario_of_log
    from obsdesign.scenario.log_defaults import ANY_LANDMARK, is_of_landmarks, read_landmarks

    if landmarks is not None:
        return load_scenario_of_log(file, read_landmarks(landmarks)), True, ()
    data = _data_of(file)
    if "replay" not in data:
        return load_scenario(file), False, ()
    sensors = data.get("sensors")
    is_open = isinstance(sensors, list) and any(is_of_landmarks(sensor) for sensor in sensors)
    note = "a sensor without a beacon stands for one at each landmark: --landmarks says where they are"
    return load_scenario_of_log(file, ANY_LANDMARK), True, (note,) if is_open else ()


def _data_of(file: Path) -> dict[str, Any]:
    """Return what a file says, nothing where it cannot be read: the loader says why."""
    import tomllib

    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return {}


def _upgrade_lines(changes: tuple[str, ...]) -> tuple[str, ...]:
    """Say what to change in a file of an earlier format."""
    return (f"it is of an earlier format, and read with {'; '.join(changes)}; write it so, with version = 1",) if changes else ()


VERB = Verb(
    name="check",
    what="read a scenario and say what is wrong with it; starts no solver",
    action=check,
    example="check my.toml",
    arguments=(SCENARIO, LANDMARKS, QUIET),
)
