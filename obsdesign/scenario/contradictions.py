"""What is wrong between values of a scenario that are each acceptable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import obsdesign.criteria
from obsdesign.errors import InputError
from obsdesign.families import kinds
from obsdesign.scenario.analysis_problems import find_analysis_problems, find_unknown_input_problems
from obsdesign.scenario.criterion_problems import criteria_of_matrices, find_criterion_problems, find_weight_problems
from obsdesign.scenario.path_problems import (
    find_baseline_problems,
    find_codesign_problems,
    find_constraint_problems,
    find_path_source_problems,
    find_position_problems,
)
from obsdesign.scenario.problem_text import Location, Problem, list_problems, unknown_key, unknown_name
from obsdesign.scenario.requirement_problems import find_requirement_problems
from obsdesign.scenario.schema import Scenario
from obsdesign.scenario.tables import Leg
from obsdesign.scenario.time_problems import find_flight_problems, find_range_problems, find_time_problems

if TYPE_CHECKING:
    from obsdesign.costs.effort import Effort

_MAX_STEPS = 1_000_000  # of a path that is designed and reported: more do not fit into memory


def find_contradictions(scenario: Scenario, has_path: bool = False, has_verdicts_alone: bool = False) -> Iterator[Problem]:
    """Yield what is wrong between values that are each acceptable.

    has_path: there is a path beside the scenario's own; has_verdicts_alone: nothing is asked but what its sensors can see.
    """
    if excess := list(_size_problems(scenario)):
        yield from excess  # nothing else could be looked at in finite time
        return
    if missing := list(_system_problems(scenario)):
        yield from missing  # nothing else could be told from its names
        return
    try:
        _ = scenario.states
    except InputError as error:  # groups, scales and biases of sensors that do not fit together
        yield Problem(("sensors",), str(error))
        return
    yield from _name_problems(scenario, has_verdicts_alone)
    yield from find_unknown_input_problems(scenario)
    yield from find_analysis_problems(scenario)
    if has_verdicts_alone:
        return
    yield from _value_problems(scenario)
    yield from _choice_problems(scenario)
    yield from _selection_problems(scenario)
    if scenario.selection.rules or scenario.selection.pareto:
        from obsdesign.scenario.rule_problems import find_rule_problems

        yield from find_rule_problems(scenario)
    yield from find_requirement_problems(scenario, has_path)
    yield from find_path_source_problems(scenario, has_path)
    yield from find_criterion_problems(scenario)
    yield from find_baseline_problems(scenario)
    yield from find_time_problems(scenario)
    yield from find_range_problems(scenario)
    yield from find_flight_problems(scenario)
    yield from find_codesign_problems(scenario)
    yield from find_position_problems(scenario)
    yield from find_constraint_problems(scenario)


def _system_problems(scenario: Scenario) -> Iterator[Problem]:
    """What is wrong with the system, or with where it comes from."""
    table = scenario.system_table
    if table is None:
        if scenario.vehicle is None:
            yield Problem(("vehicle",), "missing key")
        if not scenario.sensors:
            yield Problem(
                ("sensors",), "missing key" if "sensors" not in scenario.model_fields_set else "is empty: must be one sensor at least"
            )
        return
    for key in ("vehicle", "sensors"):
        if key in scenario.model_fields_set:
            yield Problem((key,), "does not go with [system]: a system is given by a vehicle and sensors, or as text")
    from obsdesign.scenario.system_problems import find_system_problems  # formulas are loaded where there are some

    yield from find_system_problems(table)


def _size_problems(scenario: Scenario) -> Iterator[Problem]:
    time = scenario.time
    for what, length in (("step", time.step), ("segment", time.segment)):
        if time.duration / length > _MAX_STEPS:
            message = f"is {time.duration:g} s: must be at most {_MAX_STEPS} {what}s of {length:g} s"
            yield Problem(("time", "duration"), message)


def _name_problems(scenario: Scenario, has_verdicts_alone: bool) -> Iterator[Problem]:
    states, inputs = scenario.state_names, [signal.name for signal in scenario.inputs]
    tables: list[tuple[Location, Sequence[str], Sequence[str], bool]] = [
        (("start",), tuple(scenario.start), states, bool(scenario.start) or not has_verdicts_alone),
        (("prior",), tuple(scenario.prior), states, not has_verdicts_alone),
        (("process_noise",), tuple(scenario.process_noise), (*states, *inputs), False),
        (("design", "bounds"), tuple(scenario.design.bounds), inputs, scenario.design.path is not None),
        (("design", "rates"), tuple(scenario.design.rates), inputs, False),
        *((("manoeuvres", i, "held"), tuple(manoeuvre.held), inputs, False) for i, manoeuvre in enumerate(scenario.manoeuvres)),
        *((("baselines", i, "inputs"), tuple(baseline.inputs), inputs, False) for i, baseline in enumerate(scenario.baselines)),
        *((leg_location, tuple(leg.inputs), inputs, False) for leg_location, leg in _legs(scenario)),
        *((effort_location, tuple(name for name, _ in cost.weights), inputs, False) for effort_location, cost in _efforts(scenario)),
    ]
    for location, given, accepted, complete in tables:
        yield from (unknown_key((*location, key), key, accepted) for key in given if key not in accepted)
        yield from (Problem((*location, key), "missing key") for key in accepted if complete and key not in given)


def _efforts(scenario: Scenario) -> Iterator[tuple[Location, Effort]]:
    priced = {"prices": scenario.design.prices, "budgets": scenario.design.budgets}
    if any(priced.values()):
        from obsdesign.costs.effort import Effort

        for key, tables in priced.items():
            yield from ((("design", key, i, "weights"), table.cost) for i, table in enumerate(tables) if isinstance(table.cost, Effort))


def _legs(scenario: Scenario) -> Iterator[tuple[Location, Leg]]:
    for i, path in enumerate(scenario.paths):
        for j, leg in enumerate(path.legs):
            yield ("paths", i, "legs", j, "inputs"), leg


def _value_problems(scenario: Scenario) -> Iterator[Problem]:
    yield from (Problem(("prior", key), f"is {value!r}: must be above 0") for key, value in scenario.prior.items() if value <= 0)
    yield from _noise_problems(scenario)
    for key, (low, high) in scenario.design.bounds.items():
        if low >= high:
            yield Problem(("design", "bounds", key), f"is [{low}, {high}]: the first must be below the second")


def _noise_problems(scenario: Scenario) -> Iterator[Problem]:
    for key, noise in scenario.process_noise.items():
        values = {(): noise} if isinstance(noise, (int, float)) else {("per_speed",): noise.per_speed, ("at_rest",): noise.at_rest}
        for part, value in values.items():
            if value < 0:
                yield Problem(("process_noise", key, *part), f"is {value!r}: must not be negative")
        if not isinstance(noise, (int, float)) and not {"x", "y"} <= set(scenario.state_names):
            yield Problem(("process_noise", key, "per_speed"), "is of the speed of the states x and y, which the vehicle does not have")


def _choice_problems(scenario: Scenario) -> Iterator[Problem]:
    if scenario.design.criterion not in kinds(obsdesign.criteria):
        yield unknown_name(("design", "criterion"), scenario.design.criterion, kinds(obsdesign.criteria))
    for i, suite in enumerate(scenario.design.suites):
        yield from list_problems(("design", "suites", i), suite, scenario.sensor_names)
    yield from list_problems(("design", "about"), scenario.design.about, scenario.state_names)
    if "about" in scenario.replay.model_fields_set:
        yield from list_problems(("replay", "about"), scenario.replay.about, scenario.state_names)
    yield from list_problems(("selection", "naive"), scenario.selection.naive, scenario.sensor_names)


def _selection_problems(scenario: Scenario) -> Iterator[Problem]:
    settings, sensors = scenario.selection, len(scenario.sensor_names)
    per_segment, naive = settings.per_segment, settings.naive
    criteria = criteria_of_matrices()  # a posterior is no sum over sensors
    if settings.criterion not in criteria:
        yield unknown_name(("selection", "criterion"), settings.criterion, criteria)
    if settings.robust_to >= sensors:
        yield Problem(("selection", "robust_to"), f"is {settings.robust_to}: must be below the number of sensors, {sensors}")
    if per_segment > sensors:
        yield Problem(("selection", "per_segment"), f"is {per_segment}: must be at most the number of sensors, {sensors}")
    if len(naive) > per_segment:
        yield Problem(("selection", "naive"), f"is {', '.join(naive)}: must be at most per_segment sensors, {per_segment}")
    if settings.question == "filter" and not scenario.has_filter_schedule:
        message = f"is filter: with {per_segment} of {sensors} sensors on at a time there are too many sets of them; start is possible"
        yield Problem(("selection", "question"), message)
    yield from find_weight_problems(scenario, ("selection", "over"), settings.over)
