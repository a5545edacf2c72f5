"""What is wrong between values of a scenario that are each acceptable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import obsdesign.criteria
from obsdesign.checks import whole_multiple
from obsdesign.errors import InputError
from obsdesign.families import kinds
from obsdesign.moment import Moment
from obsdesign.paths.abstract import Grid
from obsdesign.scenario.schema import Scenario
from obsdesign.scenario.wording import Location, Problem, unknown_key, unknown_name

_ROUNDING = 1e-9  # by how much a margin of order 1 may fall short where the start lies on an edge


def contradictions(scenario: Scenario) -> Iterator[Problem]:
    """Yield what is wrong between values that are each acceptable."""
    yield from _name_problems(scenario)
    yield from _value_problems(scenario)
    yield from _choice_problems(scenario)
    yield from _time_problems(scenario)
    yield from _place_problems(scenario)
    yield from _constraint_problems(scenario)
    if scenario.selection.per_segment > len(scenario.sensors):
        most = len(scenario.sensors)
        message = f"is {scenario.selection.per_segment}: must be at most the number of sensors, {most}"
        yield Problem(("selection", "per_segment"), message)


def _name_problems(scenario: Scenario) -> Iterator[Problem]:
    states, inputs = scenario.state_names, [signal.name for signal in scenario.vehicle.inputs]
    tables: list[tuple[Location, Sequence[str], Sequence[str], bool]] = [
        (("start",), tuple(scenario.start), states, True),
        (("prior",), tuple(scenario.prior), states, True),
        (("process_noise",), tuple(scenario.process_noise), states, False),
        (("design", "bounds"), tuple(scenario.design.bounds), inputs, True),
        *((("manoeuvres", i, "held"), tuple(each.held), inputs, False) for i, each in enumerate(scenario.manoeuvres)),
    ]
    for location, given, accepted, complete in tables:
        yield from (Problem((*location, key), unknown_key(key, accepted)) for key in given if key not in accepted)
        yield from (Problem((*location, key), "missing key") for key in accepted if complete and key not in given)


def _value_problems(scenario: Scenario) -> Iterator[Problem]:
    yield from (Problem(("prior", key), f"is {value!r}: must be above 0") for key, value in scenario.prior.items() if value <= 0)
    noise = scenario.process_noise.items()
    yield from (Problem(("process_noise", key), f"is {value!r}: must not be negative") for key, value in noise if value < 0)
    for key, (low, high) in scenario.design.bounds.items():
        if low >= high:
            yield Problem(("design", "bounds", key), f"is [{low}, {high}]: the first must be below the second")


def _choice_problems(scenario: Scenario) -> Iterator[Problem]:
    if scenario.design.criterion not in kinds(obsdesign.criteria):
        yield Problem(("design", "criterion"), unknown_name(scenario.design.criterion, kinds(obsdesign.criteria)))
    for i, suite in enumerate(scenario.design.suites):
        wrong = [name for name in suite if name not in scenario.sensor_names]
        yield from (Problem(("design", "suites", i), unknown_name(name, scenario.sensor_names)) for name in wrong)
    if scenario.selection.naive is not None and scenario.selection.naive not in scenario.sensor_names:
        yield Problem(("selection", "naive"), unknown_name(scenario.selection.naive, scenario.sensor_names))


def _time_problems(scenario: Scenario) -> Iterator[Problem]:
    time = scenario.time
    if time.duration < time.segment:
        yield Problem(("time", "duration"), f"is {time.duration:g} s: must be at least one segment, {time.segment:g} s")
    elif whole_multiple(time.duration, time.segment) is None:
        yield Problem(("time", "duration"), f"is {time.duration:g} s: must be a whole multiple of the segment, {time.segment:g} s")
    if whole_multiple(time.segment, time.step) is None:
        yield Problem(("time", "segment"), f"is {time.segment:g} s: must be a whole multiple of the step, {time.step:g} s")
    for i, sensor in enumerate(scenario.sensors):
        if sensor.rate is not None and whole_multiple(1 / sensor.rate, time.step) is None:
            period = f"is {sensor.rate:g} Hz, a period of {1 / sensor.rate:g} s"
            yield Problem(("sensors", i, "rate"), f"{period}: must be a whole multiple of the step, {time.step:g} s")
    if whole_multiple(time.duration, time.step) is not None:
        try:
            scenario.design.path.box(_grid(scenario))
        except InputError as error:
            yield Problem(("design", "path"), str(error))


def _grid(scenario: Scenario) -> Grid:
    names = tuple(signal.name for signal in scenario.vehicle.inputs)
    lower, upper = (tuple(scenario.design.bounds.get(name, (-1.0, 1.0))[side] for name in names) for side in (0, 1))
    return Grid(names, lower, upper, scenario.steps, scenario.time.step)


def _place_problems(scenario: Scenario) -> Iterator[Problem]:
    if not {"x", "y"} <= scenario.start.keys():
        return
    x, y = scenario.start["x"], scenario.start["y"]
    landmarks = [sensor.landmark for sensor in scenario.sensors if sensor.landmark is not None]
    for i, sensor in enumerate(scenario.sensors):
        if sensor.landmark == (x, y):
            yield Problem(("sensors", i, "beacon"), f"is {[x, y]}: must not lie on the start, where the sensor has no derivative")
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
        if margin < -_ROUNDING:
            size, unit = constraint.size
            where = ", ".join(f"{name} = {start.state[name]:g}" for name in constraint.states)
            yield Problem(("design", "constraints", i), f"is violated by the start ({where}) by {-margin * size:.3g} {unit} ({constraint})")


def _constraint_problems(scenario: Scenario) -> Iterator[Problem]:
    for i, constraint in enumerate(scenario.design.constraints):
        for name in constraint.states:
            if name not in scenario.state_names:
                yield Problem(("design", "constraints", i), f"needs the state {name!r}, which the vehicle does not have")
        for key in ("first", "last"):
            instant = getattr(constraint.span, key)
            if instant is not None and instant > scenario.time.duration:
                message = f"is {instant:g} s: must be at most the duration, {scenario.time.duration:g} s"
                yield Problem(("design", "constraints", i, key), message)
