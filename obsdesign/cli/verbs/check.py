"""`obsdesign check`: what is wrong with a scenario."""

from __future__ import annotations

import tomllib
from argparse import Namespace

from obsdesign.cli.folders import scenario_file
from obsdesign.cli.verb import QUIET, SCENARIO, Outcome, Verb


def check(options: Namespace) -> Outcome:
    """Read a scenario; raises ScenarioError that says all that is wrong with it."""
    from obsdesign.scenario.loading import load_scenario
    from obsdesign.scenario.upgrades import upgrade_data

    file = scenario_file(options.scenario)
    scenario = load_scenario(file)
    sensors = ", ".join(scenario.sensor_names)
    what = f"{scenario.title}: {len(scenario.state_names)} states, sensors {sensors}, {scenario.segments} segments"
    changes = upgrade_data(tomllib.loads(scenario.source)).changes
    document = {"file": str(file), "title": scenario.title, "ok": True, "upgraded": list(changes)}
    return Outcome(document, (f"{file}: fine ({what})", *_upgrade_lines(changes)))


def _upgrade_lines(changes: tuple[str, ...]) -> tuple[str, ...]:
    """Say what to change in a file of an earlier format."""
    return (f"it is of an earlier format, and read with {'; '.join(changes)}; write it so, with version = 1",) if changes else ()


VERB = Verb(
    name="check",
    what="read a scenario and say what is wrong with it; starts no solver",
    action=check,
    example="check my.toml",
    arguments=(SCENARIO, QUIET),
)
