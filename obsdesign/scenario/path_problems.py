"""What is wrong with the paths of a scenario: where they come from, where they begin, what they have to keep."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

from obsdesign.checks import whole_multiple
from obsdesign.errors import InputError
from obsdesign.moment import Moment
from obsdesign.scenario.path_names import DESIGNED, GIVEN, SHORTEST, STRAIGHT, WEAVE
from obsdesign.scenario.problem_text import Problem
from obsdesign.scenario.schema import Scenario

_OF_GIVEN_PATHS = ("criterion", "posterior_criterion", "over", "about", "suites", "constraints")  # keys of [design] that hold for them too
_TOLERANCE = 1e-9  # by how much a margin of order 1 may fall short where the start lies on an edge


def find_path_source_problems(scenario: Scenario, has_path: bool) -> Iterator[Problem]:
    """Yield what is wrong with where paths come from: they are designed or given, not both."""
    if scenario.design.path is None and not scenario.paths and not has_path:
        yield Problem(("design", "path") if "design" in scenario.model_fields_set else ("design",), "missing key")
    if scenario.design.path is not None and scenario.paths:
        yield Problem(("paths",), "does not go with design.path: paths are designed or given; [[baselines]] are compared with a design")
    if scenario.paths:
        unused = [("design", key) for key in sorted(scenario.design.model_fields_set - set(_OF_GIVEN_PATHS))]
        unused += [(key,) for key in ("baselines", "flight", "codesign") if getattr(scenario, key)]
        yield from (
            Problem(location, "does not go with [[paths]]: nothing is designed") for location in unused if location != ("design", "path")
        )
    names = [path.name for path in scenario.paths]
    for i, path in enumerate(scenario.paths):
        if path.name in names[:i]:
            yield Problem(("paths", i, "name"), f"is {path.name!r}: another path has that name")
        yield from _leg_problems(scenario, i)


def _leg_problems(scenario: Scenario, i: int) -> Iterator[Problem]:
    time, legs = scenario.time, scenario.paths[i].legs
    for j, leg in enumerate(legs):
        if whole_multiple(leg.seconds, time.step) is None:
            message = f"is {leg.seconds:g} s: must be a whole multiple of the step, {time.step:g} s"
            yield Problem(("paths", i, "legs", j, "seconds"), message)
    total = sum(leg.seconds for leg in legs)
    if abs(total - time.duration) > _TOLERANCE * time.duration:
        yield Problem(("paths", i, "legs"), f"take {total:g} s: must be time.duration, {time.duration:g} s")


def find_baseline_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield what is wrong with the names of baselines."""
    names = [baseline.name for baseline in scenario.baselines]
    for i, name in enumerate(names):
        if name in names[:i]:
            yield Problem(("baselines", i, "name"), f"is {name!r}: another baseline has that name")
        if name in (STRAIGHT, SHORTEST, WEAVE, DESIGNED, GIVEN) or name.startswith(f"{DESIGNED} for "):
            yield Problem(("baselines", i, "name"), f"is {name!r}: the study calls another path so")


def find_codesign_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield what does not go with path and schedule chosen at once."""
    if scenario.codesign is None:
        return
    design, selection = scenario.design, scenario.selection
    is_for_filter = scenario.codesign_question == "filter"
    unsupported = {"about": design.about and not is_for_filter, "floor": design.floor, "robust": design.robust, "shortest": design.shortest}
    for key in (key for key, value in unsupported.items() if value):
        yield Problem(("design", key), "does not go with [codesign]: a selection of sensors does not know of it")
    if is_for_filter and not scenario.has_filter_schedule and selection.per_segment <= len(scenario.sensor_names):
        sensors, allowed = len(scenario.sensor_names), selection.per_segment
        yield Problem(
            ("codesign", "question"), f"is filter: with {allowed} of {sensors} sensors on at a time there are too many sets of them"
        )
    if not is_for_filter and selection.criterion != design.criterion:
        yield Problem(("selection", "criterion"), f"is {selection.criterion}: [codesign] needs that of the design, {design.criterion}")
    if selection.robust_to:
        yield Problem(("selection", "robust_to"), f"is {selection.robust_to}: must be 0 with [codesign]")


def find_position_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield what is wrong with the start: on a landmark, or where a constraint is violated."""
    if not {"x", "y"} <= scenario.start.keys():
        return
    x, y = scenario.start["x"], scenario.start["y"]
    landmarks = scenario.landmarks
    for i, sensor in enumerate(scenario.sensors):
        if (x, y) in sensor.landmarks:
            key = next(field.name for field in fields(sensor) if getattr(sensor, field.name) == (x, y))
            yield Problem(("sensors", i, key), f"is {[x, y]}: must not lie on the start, where the sensor has no derivative")
    if (x, y) not in landmarks:
        yield from _start_problems(scenario, Moment(scenario.start, {}, {}, landmarks))


def _start_problems(scenario: Scenario, start: Moment) -> Iterator[Problem]:
    for i, constraint in enumerate(scenario.design.constraints):
        if constraint.span.first != 0 or constraint.span.anywhere:
            continue
        try:
            margin = min(constraint.margins(start), default=0.0)
        except KeyError:  # it limits rates of change, which depend on the inputs, or a state that is missing
            continue
        except InputError as error:  # the landmarks do not suit it
            yield Problem(("design", "constraints", i), str(error))
            continue
        if margin < -_TOLERANCE:
            size, unit = constraint.size
            where = ", ".join(f"{name} = {start.state[name]:g}" for name in constraint.states)
            yield Problem(("design", "constraints", i), f"is violated by the start ({where}) by {-margin * size:.3g} {unit} ({constraint})")


def find_constraint_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield states and instants of constraints that the path does not have."""
    for i, constraint in enumerate(scenario.design.constraints):
        for name in constraint.states:
            if name not in scenario.state_names:
                yield Problem(("design", "constraints", i), f"needs the state {name!r}, which the vehicle does not have")
        for key in ("first", "last"):
            instant = getattr(constraint.span, key)
            if instant is not None and instant > scenario.shortest:
                message = f"is {instant:g} s: must be at most the duration, {scenario.shortest:g} s"
                yield Problem(("design", "constraints", i, key), message)
