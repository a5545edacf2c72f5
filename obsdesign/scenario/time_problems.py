"""What is wrong with the lengths of a scenario: path, steps, segments, samples, plans."""

from __future__ import annotations

from collections.abc import Iterator

from obsdesign.checks import whole_multiple
from obsdesign.errors import InputError
from obsdesign.paths.abstract import AbstractCheckablePath, Grid
from obsdesign.scenario.problem_text import Problem
from obsdesign.scenario.schema import Scenario


def find_time_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield where duration, segments, steps, samples and the family of paths do not fit together."""
    time = scenario.time
    if time.duration < time.segment:
        yield Problem(("time", "duration"), f"is {time.duration:g} s: must be at least one segment, {time.segment:g} s")
    elif scenario.design.shortest is None and whole_multiple(time.duration, time.segment) is None:
        yield Problem(("time", "duration"), f"is {time.duration:g} s: must be a whole multiple of the segment, {time.segment:g} s")
    if whole_multiple(time.segment, time.step) is None:
        yield Problem(("time", "segment"), f"is {time.segment:g} s: must be a whole multiple of the step, {time.step:g} s")
    for location, rate in scenario.sample_rates.items():
        if rate is not None and whole_multiple(1 / rate, time.step) is None:
            period = f"is {rate:g} Hz, a period of {1 / rate:g} s"
            yield Problem(location, f"{period}: must be a whole multiple of the step, {time.step:g} s")
    for duration in dict.fromkeys((scenario.shortest, time.duration)):
        if whole_multiple(duration, time.step) is not None:
            yield from _path_problems(scenario, duration)


def _path_problems(scenario: Scenario, duration: float) -> Iterator[Problem]:
    path = scenario.design.path
    if path is None:
        return
    names = tuple(signal.name for signal in scenario.inputs)
    lower, upper = (tuple(scenario.design.bounds.get(name, (-1.0, 1.0))[side] for name in names) for side in (0, 1))
    grid = Grid(names, lower, upper, round(duration / scenario.time.step), scenario.time.step)
    try:
        path.require_suits(grid) if isinstance(path, AbstractCheckablePath) else path.box(grid)
    except InputError as error:
        yield Problem(("design", "path"), str(error))


def find_range_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield what is wrong with the range of durations, and with what has to fit into the shortest."""
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
    if not design.budgets:
        return
    from obsdesign.costs.flight_time import FlightTime

    for i, budget in enumerate(design.budgets):
        if isinstance(budget.cost, FlightTime) and budget.at_most < shortest:
            yield Problem(("design", "budgets", i, "at_most"), f"is {budget.at_most:g} s: must be at least the duration, {shortest:g} s")


def find_flight_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield what is wrong with a flight and its plans."""
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
