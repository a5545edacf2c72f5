"""`obsdesign check`: what is wrong with a scenario."""

from __future__ import annotations

from argparse import Namespace

from obsdesign.cli.verb import QUIET, SCENARIO, Outcome, Verb


def check(options: Namespace) -> Outcome:
    """Read a scenario; raises ScenarioError that says all that is wrong with it."""
    from obsdesign.scenario.loading import load_scenario

    scenario = load_scenario(options.scenario)
    sensors = ", ".join(scenario.sensor_names)
    what = f"{scenario.title}: {len(scenario.state_names)} states, sensors {sensors}, {scenario.segments} segments"
    document = {"file": str(options.scenario), "title": scenario.title, "ok": True}
    return Outcome(document, (f"{options.scenario}: fine ({what})",))


VERB = Verb(
    name="check",
    what="read a scenario and say what is wrong with it; starts no solver",
    action=check,
    example="check my.toml",
    arguments=(SCENARIO, QUIET),
)
