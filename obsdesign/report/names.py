"""What paths, limits and shortfalls are called in sentences."""

from __future__ import annotations

import re

from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.design.violation import Violation
from obsdesign.report.number_format import NARROW, display_unit, join, numeral, percent, plain
from obsdesign.scenario.path_names import SHORTEST, STRAIGHT, WEAVE
from obsdesign.scenario.schema import Scenario
from obsdesign.selection.posterior.requirement import RequiredKnowledge
from obsdesign.signals import Signal
from obsdesign.study.rated_schedules import FilterAnswer
from obsdesign.study.record import Study

_MAX_NAMED = 3  # limits that are named


def path_in_words(name: str) -> str:
    """Return what a path is called in a sentence."""
    words = {WEAVE: "the best weave that meets the same limits", SHORTEST: "the shortest way to the goal", STRAIGHT: "the straight path"}
    return words.get(name, f"the path {name}" if " " in name else f"the {name} path")


def criterion_name(study: Study) -> str:
    """Return what the value of a path is called."""
    name, about = study.scenario.criterion.label, study.scenario.design.about
    return f"{name} about {', '.join(about)}" if about else name


def schedule_criterion(study: Study) -> str:
    """Return what the value of a schedule is called."""
    return study.scenario.schedule_criterion.label


def path_suffix(study: Study) -> str:
    """Return which of several given paths a question is about."""
    return "" if study.designs or len(study.candidates) == 1 else f" {capitalise(path_in_words(study.about))}"


def capitalise(text: str) -> str:
    """Return a sentence that begins with a capital."""
    return text[:1].upper() + text[1:]


def has_relative_gap(study: Study) -> bool:
    """Whether the gap of a schedule is a share of its bound."""
    return study.scenario.schedule_criterion.gap_kind == "relative"


def gap_in_words(study: Study) -> str:
    """Return the gap of the schedule: a share of the bound, or a difference where those count."""
    gap = study.selection.schedule.gap
    return percent(gap) if has_relative_gap(study) else numeral(gap)


_OTHER_COST = "what the scenario's criterion makes of the filter's covariance"
_COSTS = {
    "trace_inverse": "the sum of the variances of the filter's errors",
    "min_eigenvalue": "the variance of the filter's error in the combination of states known least",
    "log_det": "the log determinant of the filter's covariance",
}
_INSTANTS = {"mean": "averaged over the way", "worst": "at the worst instant", "end": "at the last samples"}


def minimised_in_words(scenario: Scenario) -> str:
    """Return what a schedule for the filter minimises."""
    about, over = scenario.design.about, scenario.selection.over
    when = _INSTANTS[over] if isinstance(over, str) else "weighted over the way"
    return f"{_COSTS.get(scenario.filter_criterion_kind, _OTHER_COST)}{' in ' + ', '.join(about) if about else ''}, {when}"


def requirement_in_words(required: RequiredKnowledge) -> str:
    """Return what is required: x and y within 8 m from 20 s on."""
    requirement, signal = required.requirement, Signal("", required.unit)
    factor, unit = display_unit(signal)
    share = "" if requirement.share == 1 else f" at {percent(requirement.share)} of the instants"
    after = f" later than {plain(requirement.after)}{NARROW}s" if requirement.after else ""
    return f"{join(list(requirement.about))} within {plain(round(factor * requirement.at_most, 9))}{NARROW}{unit}{share}{after}"


def asked_gap(study: Study) -> str:
    """Return the gap of the schedule that the study uses."""
    answer, cheapest, used = study.selection.filter, study.selection.cheapest, study.selection.question_in_use
    if used == "cheapest" and cheapest is not None:
        return percent(cheapest.schedule.gap)
    return gap_in_words(study) if used == "start" or answer is None else filter_gap(study, answer)


def filter_gap(study: Study, answer: FilterAnswer) -> str:
    """Return the gap of the schedule for the filter: a share of its cost, or a difference where those count."""
    is_relative = study.scenario.filter_criterion.gap_kind == "relative"
    return percent(answer.schedule.gap) if is_relative else numeral(answer.schedule.gap)


def gap_formula(study: Study) -> str:
    """Return what the gap is, as its criterion counts differences."""
    return "gap = (bound − value) / |bound|" if has_relative_gap(study) else "gap = bound − value"


def violation_in_words(violation: Violation) -> str:
    """Return what is wrong with a path and by how much: misses the goal by 3.2 m."""
    factor, unit = display_unit(Signal("", violation.unit))
    amount = f"{numeral(violation.by * factor)}{NARROW}{unit}".rstrip(NARROW)
    return f"{violation.constraint.breach} by {amount}"


def violations_in_words(violations: tuple[Violation, ...]) -> str:
    """Return the worst few shortfalls in words, and how many there are beside them."""
    words = list(dict.fromkeys(map(violation_in_words, violations[:_MAX_NAMED])))
    unnamed = len(violations) - _MAX_NAMED
    return "; ".join([*words, *([f"{unnamed} more"] if unnamed > 0 else [])])


def kind_of(constraint: AbstractConstraint) -> str:
    """Return what a map's legend calls a constraint: keep out, stand off."""
    return re.sub(r"(?<!^)(?=[A-Z])", " ", type(constraint).__name__).lower()
