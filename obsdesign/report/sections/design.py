"""Sentences about how a path was found: starts, duration, prices, draws of the prior, how much better another might be."""

from __future__ import annotations

from obsdesign.design.record import Design
from obsdesign.report import derived_quantities as facts
from obsdesign.report.names import criterion_name
from obsdesign.report.number_format import NARROW, join, numeral, percent, plain
from obsdesign.study.record import Study

_MAX_NAMED = 4  # optima that are named


def design_in_words(study: Study, i: int) -> str:
    """Say of the design for a suite what its starts came to, and what else is known about it."""
    design, who = study.designs[i], facts.sensors_in_words(study, study.suites[i])
    parts = (_optima(design), _duration(study, design), _prices(study, design), _robustness(study, design), _evidence(study, design))
    return f"Designed for {who}: {' '.join(filter(None, parts))}"


def objective_name(study: Study) -> str:
    """Return what is maximised: the criterion, or more than that."""
    design = study.scenario.design
    return "objective" if design.prices or design.robust else criterion_name(study)


def _optima(design: Design) -> str:
    """What the starts that were climbed to the end came to; values to five digits, which tell optima apart."""
    refined = [start for start in design.starts if start.refined]
    values = [f"{numeral(optimum.value, 5)} ({_starts(len(optimum.starts))})" for optimum in design.optima[:_MAX_NAMED]]
    unnamed = len(design.optima) - _MAX_NAMED
    values += [f"{unnamed} more"] if unnamed > 0 else []
    few = "one optimum" if len(design.optima) == 1 else f"{len(design.optima)} distinct optima"
    all_of = len(refined) == len(design.starts)
    who = _starts(len(refined)) if all_of else f"{len(refined)} of {_starts(len(design.starts))}, the best in a coarser family,"
    return f"{who} climbed to {few}: {join(values)}."


def _starts(count: int) -> str:
    return f"{count} start{'s' * (count != 1)}"


def _duration(study: Study, design: Design) -> str:
    if study.scenario.design.shortest is None:
        return ""
    low, high = plain(study.scenario.shortest), plain(study.scenario.time.duration)
    return f"Of durations from {low} to {high}{NARROW}s the best found is {plain(design.problem.longest)}{NARROW}s."


def _prices(study: Study, design: Design) -> str:
    if not design.problem.prices or design.trajectory is None:
        return ""
    paid = design.problem.price(design.trajectory)
    costs = join([f"{numeral(price.per_unit)} for every {_unit(price.cost.unit)}of {price.cost}" for price in design.problem.prices])
    of = "the draws' value" if design.problem.robust else criterion_name(study)
    return f"The objective {numeral(design.objective)} is {of} less {numeral(paid)} paid, {costs}."


def _unit(unit: str) -> str:
    return f"{unit} " if unit else "unit "


def _robustness(study: Study, design: Design) -> str:
    result, robust = design.robustness, design.problem.robust
    if result is None or robust is None:
        return ""
    by = "worst" if robust.worst else "mean"
    return (
        f"It is judged by the {by} of {robust.samples} draws of the prior. Over {plain(result.draws)} fresh draws with the same inputs "
        f"{criterion_name(study)} is {numeral(result.mean)} on average, at least {numeral(result.five_percent)} in 95{NARROW}% of them and "
        f"{numeral(result.worst)} at worst."
    )


def _evidence(study: Study, design: Design) -> str:
    evidence = design.evidence
    if evidence is None:
        return ""
    return (
        f"How much better might another path be? {plain(evidence.climbs)} climbs along the dual question met no path above "
        f"{numeral(evidence.estimate)}: as far as they tell, none has a {criterion_name(study)} that is better by more than "
        f"{percent(evidence.remaining / (1 - evidence.remaining) if evidence.remaining < 1 else 1.0)}. That is evidence, not proof."
    )
