"""What is wrong with the requirements of a scenario, and with what sensors cost."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from obsdesign.scenario.problem_text import Location, Problem, list_problems, unknown_key

if TYPE_CHECKING:
    from obsdesign.scenario.schema import Scenario
    from obsdesign.scenario.selection_tables import RequirementTable

_PLACE = ("selection", "requirements")
_ROUNDING = 1e-9  # of a step


def find_requirement_problems(scenario: Scenario, has_path: bool) -> Iterator[Problem]:
    """Yield what is wrong with the requirements of a scenario, or with keys that need some; has_path: its own times do not count."""
    settings, sensors = scenario.selection, scenario.sensor_names
    for i, table in enumerate(settings.requirements):
        yield from _problems_of_one(scenario, (*_PLACE, i), table)
        if not has_path:
            yield from _time_problems(scenario, (*_PLACE, i, "after"), table.after)
    for key, costs in (("cost", settings.cost), ("start", settings.start)):
        yield from (unknown_key(("selection", key, name), name, sensors) for name in costs or () if name not in sensors)
    if settings.requirements:
        yield from _problems_of_all(scenario)
        return
    unused = [key for key in ("cost", "start") if key in settings.model_fields_set]
    yield from (
        Problem(("selection", key), "needs [[selection.requirements]]: it counts for the cheapest schedule alone") for key in unused
    )
    if settings.question == "cheapest":
        yield Problem(("selection", "question"), "is cheapest: needs [[selection.requirements]], one at least")


def _problems_of_one(scenario: Scenario, location: Location, table: RequirementTable) -> Iterator[Problem]:
    states = {signal.name: signal.unit for signal in scenario.moving_states}
    yield from list_problems((*location, "about"), table.about, tuple(states))
    units = {name: states[name] for name in table.about if name in states}
    if len(set(units.values())) > 1:
        shown = ", ".join(f"{name} in {unit or 'no unit'}" for name, unit in units.items())
        yield Problem((*location, "about"), f"has {shown}: states that are summed must have one unit; give a requirement for each")


def _time_problems(scenario: Scenario, location: Location, after: float) -> Iterator[Problem]:
    step = scenario.time.step
    last = step * (round(scenario.shortest / step) - 1)
    if after >= last - _ROUNDING * step:
        yield Problem(location, f"is {after:g} s: must be before the last samples, at {max(last, 0.0):g} s")


def _problems_of_all(scenario: Scenario) -> Iterator[Problem]:
    settings = scenario.selection
    if settings.robust_to:
        message = f"is {settings.robust_to}: must be 0 with [[selection.requirements]], which no proof is known for where sensors are lost"
        yield Problem(("selection", "robust_to"), message)
    if not scenario.has_filter_schedule and settings.per_segment <= len(scenario.sensor_names):
        sensors, allowed = len(scenario.sensor_names), settings.per_segment
        yield Problem(("selection", "requirements"), f"with {allowed} of {sensors} sensors on at a time there are too many sets of them")
