"""What is wrong in the table [analysis]."""

from __future__ import annotations

from collections.abc import Iterator

from obsdesign.scenario.problem_text import Problem, list_problems, unknown_name
from obsdesign.scenario.schema import Scenario


def find_analysis_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield names that nothing has, subsets and disturbances that stand there twice, a point without all of its states."""
    settings, names = scenario.analysis, scenario.state_names
    for i, subset in enumerate(settings.subsets):
        yield from list_problems(("analysis", "subsets", i), subset, scenario.sensor_names)
    for key, values in (("subsets", tuple(map(frozenset, settings.subsets))), ("disturbances", settings.disturbances)):
        yield from (Problem(("analysis", key, i), "stands there twice") for i, value in enumerate(values) if value in values[:i])
    yield from list_problems(("analysis", "known_at_start"), settings.known_at_start, names)
    if isinstance(settings.point, dict):
        yield from (unknown_name(("analysis", "point"), name, names) for name in settings.point if name not in names)
        yield from (Problem(("analysis", "point", name), "missing key") for name in names if name not in settings.point)
    elif "point" in settings.model_fields_set and settings.point == "start" and not scenario.start:
        yield Problem(("analysis", "point"), "is start: there is no table [start]; generic, or a value for each state, is possible")


def find_unknown_input_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield unknown inputs that the vehicle does not have, or that a system as text names itself."""
    if scenario.vehicle is not None:
        yield from list_problems(("unknown_inputs",), scenario.unknown_inputs, tuple(signal.name for signal in scenario.vehicle.inputs))
    elif scenario.unknown_inputs:
        yield Problem(("unknown_inputs",), "goes with a vehicle: a [system] names them in `unknown`")
