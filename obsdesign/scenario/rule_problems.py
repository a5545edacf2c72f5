"""What is wrong with the rules for schedules, as far as it can be told before there is a path."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from itertools import combinations
from math import ceil, comb
from typing import TYPE_CHECKING

from obsdesign.errors import InputError
from obsdesign.rules.abstract import AbstractRule, Segments, Terms
from obsdesign.rules.energy_budget import EnergyBudget
from obsdesign.rules.unavailable_between import UnavailableBetween
from obsdesign.rules.unavailable_outside import UnavailableOutside
from obsdesign.scenario.problem_text import Location, Problem, unknown_key, unknown_name

if TYPE_CHECKING:
    from obsdesign.scenario.schema import Scenario

_SENSOR_KEYS = ("sensor", "other", "sensors")  # keys that name sensors
_TABLE_KEYS = ("cost", "start")  # and those that may be tables by sensor
_MAX_SUBSETS = 5_000  # sets of sensors that are looked at


def find_rule_problems(scenario: Scenario) -> Iterator[Problem]:
    """Yield what is wrong with the rules of a scenario."""
    rules = scenario.selection.rules
    unknown = [problem for i, rule in enumerate(rules) for problem in _name_problems(scenario, i, rule)]
    yield from unknown
    yield from _pareto_problems(scenario)
    if unknown or scenario.selection.per_segment > len(scenario.sensor_names):
        return
    terms: list[Terms] = []
    for i, rule in enumerate(rules):
        location: Location = ("selection", "rules", i)
        try:
            terms.append(_terms(scenario, rule))
        except InputError as error:
            yield Problem(location, str(error))
            return
        yield from (Problem((*location, *key), message) for key, message in _budget_problems(scenario, rule, terms[-1]))
    yield from _combination_problems(scenario, terms)


def _name_problems(scenario: Scenario, i: int, rule: AbstractRule) -> Iterator[Problem]:
    names, field_names = scenario.sensor_names, {field.name for field in fields(rule)}  # pyright: ignore[reportArgumentType]
    for key in field_names & set(_SENSOR_KEYS):
        given = getattr(rule, key)
        for sensor in given if isinstance(given, tuple) else (given,):
            if sensor is not None and sensor not in names:
                yield unknown_name(("selection", "rules", i, key), str(sensor), names)
    for key in field_names & set(_TABLE_KEYS):
        table = getattr(rule, key)
        wrong = [sensor for sensor in table if sensor not in names] if isinstance(table, Mapping) else []
        yield from (unknown_key(("selection", "rules", i, key, str(sensor)), str(sensor), names) for sensor in wrong)


def _pareto_problems(scenario: Scenario) -> Iterator[Problem]:
    points, budgets = scenario.selection.pareto, [rule for rule in scenario.selection.rules if isinstance(rule, EnergyBudget)]
    if points == 1:
        yield Problem(("selection", "pareto"), "is 1: must be 0, for none, or at least 2")
    if points and len(budgets) != 1:
        yield Problem(
            ("selection", "pareto"), f"is {points}: needs one rule of kind energy_budget, whose costs it counts; there are {len(budgets)}"
        )
    if points and scenario.selection.robust_to:
        yield Problem(("selection", "pareto"), f"is {points}: does not go with robust_to")


def _terms(scenario: Scenario, rule: AbstractRule) -> Terms:
    """What a rule says of the longest path; nothing where that depends on where the path goes."""
    import numpy as np

    if isinstance(rule, UnavailableOutside):
        return Terms()
    t = np.minimum(np.arange(_segments(scenario) + 1) * scenario.time.segment, scenario.time.duration)
    return rule.terms(Segments(scenario.sensor_names, _segments(scenario), t))


def _segments(scenario: Scenario) -> int:
    """K of the longest path; the last segment may be shorter than the others."""
    return max(1, ceil(scenario.time.duration / scenario.time.segment - 1e-9))


def _budget_problems(scenario: Scenario, rule: AbstractRule, terms: Terms) -> Iterator[tuple[Location, str]]:
    if isinstance(rule, UnavailableBetween) and rule.first >= scenario.time.duration:
        yield ("first",), f"is {rule.first:g} s: must be before the end of the path, {scenario.time.duration:g} s"
    resource = terms.resource
    if isinstance(rule, EnergyBudget) and resource is not None:
        smallest_usage = float((resource.usage + resource.start).min())
        if smallest_usage > resource.limit:
            yield ("limit",), f"is {rule.limit:g}: must be at least what the cheapest sensor takes in one segment, {smallest_usage:g}"


def _combination_problems(scenario: Scenario, terms: list[Terms]) -> Iterator[Problem]:
    """Rules that leave a segment without any sensor, or a sensor without any use."""
    if all(term.available is None and term.admissible is None for term in terms):
        return
    import numpy as np

    settings, names = scenario.selection, scenario.sensor_names
    masks = [term.available for term in terms if term.available is not None]
    available = np.logical_and.reduce(masks) if masks else np.ones((_segments(scenario), len(names)), dtype=bool)
    if sum(comb(len(names), size) for size in range(1, settings.per_segment + 1)) > _MAX_SUBSETS:
        return
    subsets = [subset for size in range(1, settings.per_segment + 1) for subset in combinations(range(len(names)), size)]
    patterns = np.array([[s in subset for s in range(len(names))] for subset in subsets])
    for term in terms:
        if term.admissible is not None:
            patterns = patterns[term.admissible(patterns)]
    unusable = [name for name, used in zip(names, np.any(patterns, axis=0).tolist(), strict=True) if not used]
    if unusable:
        yield Problem(
            ("selection", "rules"),
            f"{unusable[0]} can never be on, with {settings.per_segment} per segment: the rules contradict each other",
        )
        return
    possible = (~available).astype(float) @ patterns.T == 0
    empty = np.flatnonzero(~possible.any(axis=1))
    if len(empty):
        suffix = f" and {len(empty) - 1} more" if len(empty) > 1 else ""
        yield Problem(("selection", "rules"), f"leave no sensor that may be on in segment {empty[0]}{suffix}")
