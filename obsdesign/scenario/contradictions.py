"""What is wrong between values of a scenario that are each acceptable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields

import obsdesign.criteria
from obsdesign.checks import whole_multiple
from obsdesign.costs.effort import Effort
from obsdesign.costs.flight_time import FlightTime
from obsdesign.errors import InputError
from obsdesign.families import kinds
from obsdesign.moment import Moment
from obsdesign.paths.abstract import Grid
from obsdesign.scenario.problem_text import Location, Problem, unknown_key, unknown_name
from obsdesign.scenario.requirement_problems import find_requirement_problems
from obsdesign.scenario.rule_problems import find_rule_problems
from obsdesign.scenario.schema import DESIGNED, GIVEN, SHORTEST, STRAIGHT, WEAVE, Leg, Scenario

_OF_GIVEN_PATHS = ("criterion", "posterior_criterion", "over", "about", "suites", "constraints")  # keys of [design] that hold for them too
_MAX_STEPS = 1_000_000  # of a path that is designed and reported: more do not fit into memory
_TOLERANCE = 1e-9  # by how much a margin of order 1 may fall short where the start lies on an edge


def find_contradictions(scenario: Scenario, has_path: bool = False) -> Iterator[Problem]:
    """Yield what is wrong between values that are each acceptable; has_path: there is a path beside the scenario's own."""
    if excess := list(_size_problems(scenario)):
        yield from excess  # nothing else could be looked at in finite time
        return
    try:
        _ = scenario.states
    except InputError as error:  # groups, scales and biases of sensors that do not fit together
        yield Problem(("sensors",), str(error))
        return
    yield from _name_problems(scenario)
    yield from _value_problems(scenario)
    yield from _choice_problems(scenario)
    yield from _selection_problems(scenario)
    yield from find_rule_problems(scenario)
    yield from find_requirement_problems(scenario, has_path)
    yield from _path_source_problems(scenario, has_path)
    yield from _criterion_problems(scenario)
    yield from _baseline_problems(scenario)
    yield from _time_problems(scenario)
    yield from _range_problems(scenario)
    yield from _flight_problems(scenario)
    yield from _codesign_problems(scenario)
    yield from _position_problems(scenario)
    yield from _constraint_problems(scenario)


def _size_problems(scenario: Scenario) -> Iterator[Problem]:
    time = scenario.time
    for what, length in (("step", time.step), ("segment", time.segment)):
        if time.duration / length > _MAX_STEPS:
            message = f"is {time.duration:g} s: must be at most {_MAX_STEPS} {what}s of {length:g} s"
            yield Problem(("time", "duration"), message)


def _name_problems(scenario: Scenario) -> Iterator[Problem]:
    states, inputs = scenario.state_names, [signal.name for signal in scenario.vehicle.inputs]
    tables: list[tuple[Location, Sequence[str], Sequence[str], bool]] = [
        (("start",), tuple(scenario.start), states, True),
        (("prior",), tuple(scenario.prior), states, True),
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
    for key in ("prices", "budgets"):
        for i, table in enumerate(getattr(scenario.design, key)):
            if isinstance(table.cost, Effort):
                yield ("design", key, i, "weights"), table.cost


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
        yield from _list_problems(("design", "suites", i), suite, scenario.sensor_names)
    yield from _list_problems(("design", "about"), scenario.design.about, scenario.state_names)
    if "about" in scenario.replay.model_fields_set:
        yield from _list_problems(("replay", "about"), scenario.replay.about, scenario.state_names)
    yield from _list_problems(("selection", "naive"), scenario.selection.naive, scenario.sensor_names)


def _list_problems(location: Location, names: Sequence[str], accepted: Sequence[str]) -> Iterator[Problem]:
    yield from (unknown_name(location, name, accepted) for name in names if name not in accepted)
    yield from (Problem(location, f"names {name!r} twice") for i, name in enumerate(names) if name in names[:i])


def _selection_problems(scenario: Scenario) -> Iterator[Problem]:
    settings, sensors = scenario.selection, len(scenario.sensor_names)
    per_segment, naive = settings.per_segment, settings.naive
    criteria = _criteria_of_matrices()  # a posterior is no sum over sensors
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
    yield from _weight_problems(scenario, ("selection", "over"), settings.over)


def _criteria_of_matrices() -> list[str]:
    """Kinds of criteria that judge a matrix by itself."""
    return [kind for kind in kinds(obsdesign.criteria) if kind != "posterior"]


def _criterion_problems(scenario: Scenario) -> Iterator[Problem]:
    design = scenario.design
    yield from _posterior_problems(scenario)
    if design.criterion == "posterior":
        reasons = {"robust": "has a prior of its own", "floor": "has no windows"}
        wrong = [key for key in reasons if getattr(design, key) is not None]
        yield from (Problem(("design", key), f"does not go with the criterion posterior, which {reasons[key]}") for key in wrong)
    if design.evidence and (design.criterion != "min_eigenvalue" or design.prices or design.robust):
        message = f"is {design.evidence}: must be 0 unless the criterion is min_eigenvalue, without prices and robust"
        yield Problem(("design", "evidence"), message)


def _posterior_problems(scenario: Scenario) -> Iterator[Problem]:
    """What says how a posterior is judged, and when."""
    design = scenario.design
    if design.posterior_criterion not in _criteria_of_matrices():
        yield unknown_name(("design", "posterior_criterion"), design.posterior_criterion, _criteria_of_matrices())
    if design.criterion != "posterior":
        unused = [key for key in ("posterior_criterion", "over") if key in design.model_fields_set]
        yield from (Problem(("design", key), f"needs the criterion posterior: it is {design.criterion}") for key in unused)
    yield from _weight_problems(scenario, ("design", "over"), design.over)


def _weight_problems(scenario: Scenario, location: Location, over: str | tuple[float, ...]) -> Iterator[Problem]:
    """What is wrong with the weights of instants."""
    if isinstance(over, str):
        return
    for i, weight in enumerate(over):
        if weight < 0:
            yield Problem((*location, i), f"is {weight:g}: must be at least 0")
    if not any(over):
        yield Problem(location, f"has {len(over)} weights, all 0: one at least must be above 0")
    if scenario.design.shortest is not None:
        yield Problem(location, "has weights, one for each step: they do not go with design.shortest")
    elif len(over) != scenario.steps:
        yield Problem(location, f"has {len(over)} weights: must be {scenario.steps}, one for each step of the path")


def _path_source_problems(scenario: Scenario, has_path: bool) -> Iterator[Problem]:
    """Paths are designed or given, not both."""
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


def _baseline_problems(scenario: Scenario) -> Iterator[Problem]:
    names = [baseline.name for baseline in scenario.baselines]
    for i, name in enumerate(names):
        if name in names[:i]:
            yield Problem(("baselines", i, "name"), f"is {name!r}: another baseline has that name")
        if name in (STRAIGHT, SHORTEST, WEAVE, DESIGNED, GIVEN) or name.startswith(f"{DESIGNED} for "):
            yield Problem(("baselines", i, "name"), f"is {name!r}: the study calls another path so")


def _time_problems(scenario: Scenario) -> Iterator[Problem]:
    time = scenario.time
    if time.duration < time.segment:
        yield Problem(("time", "duration"), f"is {time.duration:g} s: must be at least one segment, {time.segment:g} s")
    elif scenario.design.shortest is None and whole_multiple(time.duration, time.segment) is None:
        yield Problem(("time", "duration"), f"is {time.duration:g} s: must be a whole multiple of the segment, {time.segment:g} s")
    if whole_multiple(time.segment, time.step) is None:
        yield Problem(("time", "segment"), f"is {time.segment:g} s: must be a whole multiple of the step, {time.step:g} s")
    for i, sensor in enumerate(scenario.sensors):
        if sensor.rate is not None and whole_multiple(1 / sensor.rate, time.step) is None:
            period = f"is {sensor.rate:g} Hz, a period of {1 / sensor.rate:g} s"
            yield Problem(("sensors", i, "rate"), f"{period}: must be a whole multiple of the step, {time.step:g} s")
    for duration in dict.fromkeys((scenario.shortest, time.duration)):
        if whole_multiple(duration, time.step) is not None:
            yield from _path_problems(scenario, duration)


def _path_problems(scenario: Scenario, duration: float) -> Iterator[Problem]:
    if scenario.design.path is None:
        return
    names = tuple(signal.name for signal in scenario.vehicle.inputs)
    lower, upper = (tuple(scenario.design.bounds.get(name, (-1.0, 1.0))[side] for name in names) for side in (0, 1))
    try:
        scenario.design.path.box(Grid(names, lower, upper, round(duration / scenario.time.step), scenario.time.step))
    except InputError as error:
        yield Problem(("design", "path"), str(error))


def _range_problems(scenario: Scenario) -> Iterator[Problem]:
    time, design, shortest = scenario.time, scenario.design, scenario.shortest
    if whole_multiple(time.duration, time.step) is None and design.shortest is not None:
        yield Problem(("time", "duration"), f"is {time.duration:g} s: must be a whole multiple of the step, {time.step:g} s")
    if shortest > time.duration:
        yield Problem(("design", "shortest"), f"is {shortest:g} s: must be at most time.duration, {time.duration:g} s")
    elif whole_multiple(shortest, time.step) is None and design.shortest is not None:
        yield Problem(("design", "shortest"), f"is {shortest:g} s: must be a whole multiple of the step, {time.step:g} s")
    if design.floor is not None:
        seconds = design.floor.seconds
        if seconds > shortest:
            yield Problem(("design", "floor", "seconds"), f"is {seconds:g} s: must be at most the duration, {shortest:g} s")
        elif whole_multiple(seconds, time.step) is None:
            yield Problem(("design", "floor", "seconds"), f"is {seconds:g} s: must be a whole multiple of the step, {time.step:g} s")
    for i, budget in enumerate(design.budgets):
        if isinstance(budget.cost, FlightTime) and budget.at_most < shortest:
            yield Problem(("design", "budgets", i, "at_most"), f"is {budget.at_most:g} s: must be at least the duration, {shortest:g} s")


def _codesign_problems(scenario: Scenario) -> Iterator[Problem]:
    if scenario.codesign is None:
        return
    design, selection = scenario.design, scenario.selection
    is_for_filter = scenario.codesign_question == "filter"
    unsupported = {"about": design.about and not is_for_filter, "floor": design.floor, "robust": design.robust, "shortest": design.shortest}
    for key in (key for key, value in unsupported.items() if value):
        yield Problem(("design", key), "does not go with [codesign]: a selection of sensors does not know of it")
    if is_for_filter and not scenario.has_filter_schedule and selection.per_segment <= len(scenario.sensors):
        sensors, allowed = len(scenario.sensors), selection.per_segment
        yield Problem(
            ("codesign", "question"), f"is filter: with {allowed} of {sensors} sensors on at a time there are too many sets of them"
        )
    if not is_for_filter and selection.criterion != design.criterion:
        yield Problem(("selection", "criterion"), f"is {selection.criterion}: [codesign] needs that of the design, {design.criterion}")
    if selection.robust_to:
        yield Problem(("selection", "robust_to"), f"is {selection.robust_to}: must be 0 with [codesign]")


def _flight_problems(scenario: Scenario) -> Iterator[Problem]:
    flight, time = scenario.flight, scenario.time
    if flight is None:
        return
    for key in ("every", "duration"):
        seconds = getattr(flight, key)
        if whole_multiple(seconds, time.step) is None:
            yield Problem(("flight", key), f"is {seconds:g} s: must be a whole multiple of the step, {time.step:g} s")
    for key, longest in (("flight.duration", flight.duration), ("time.duration", time.duration)):
        if flight.every > longest:
            yield Problem(("flight", "every"), f"is {flight.every:g} s: must be at most {key}, {longest:g} s")
    if flight.horizon == "shrinking" and flight.duration > time.duration:
        message = f"is {flight.duration:g} s: must be at most time.duration, {time.duration:g} s, where the horizon is shrinking"
        yield Problem(("flight", "duration"), message)
    if scenario.design.shortest is not None:
        yield Problem(("design", "shortest"), "does not go with [flight]: a plan needs one duration")


def _position_problems(scenario: Scenario) -> Iterator[Problem]:
    if not {"x", "y"} <= scenario.start.keys():
        return
    x, y = scenario.start["x"], scenario.start["y"]
    landmarks = [point for sensor in scenario.sensors for point in sensor.landmarks]
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


def _constraint_problems(scenario: Scenario) -> Iterator[Problem]:
    for i, constraint in enumerate(scenario.design.constraints):
        for name in constraint.states:
            if name not in scenario.state_names:
                yield Problem(("design", "constraints", i), f"needs the state {name!r}, which the vehicle does not have")
        for key in ("first", "last"):
            instant = getattr(constraint.span, key)
            if instant is not None and instant > scenario.shortest:
                message = f"is {instant:g} s: must be at most the duration, {scenario.shortest:g} s"
                yield Problem(("design", "constraints", i, key), message)
