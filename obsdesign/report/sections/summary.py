"""The top of the page: one sentence, and the numbers that stand for the sections."""

from __future__ import annotations

from obsdesign.report import derived_quantities as facts
from obsdesign.report.names import asked_gap, capitalise, criterion_name, path_in_words
from obsdesign.report.number_format import join, numeral, percent, with_unit
from obsdesign.report.section import KeyNumber
from obsdesign.report.sections.schedule import answer as schedule_answer
from obsdesign.report.sections.schedule import schedule_in_words
from obsdesign.status import Status
from obsdesign.study.record import FilterCheck, Study


def answer(study: Study) -> str:
    """One sentence for the designed path, or one for each given path."""
    if not study.checks:
        return schedule_answer(study)
    return " ".join(_study_answer(path_study) for path_study in study.each)


def headline(study: Study) -> tuple[KeyNumber, ...]:
    """Return the number that stands for each section."""
    everything = [analysis.verdict for analysis in study.analyses if set(analysis.sensors) == set(study.scenario.sensor_names)]
    dimension, n = max((verdict.dimension for verdict in everything), default=0), len(study.scenario.state_names)
    can = KeyNumber("can", f"{dimension} of {n}", "dimensions seen with all sensors")
    along = [number for path_study in study.each for number in _headline_along(path_study)]
    return (*((can,) if everything else ()), *along, *_headline_of_flight(study))


def _headline_along(study: Study) -> tuple[KeyNumber, ...]:
    value, path = facts.value_of(study, study.main.qualities[0]), path_in_words(study.about)
    how = KeyNumber(f"how{facts.drawing_suffix(study)}" if study.designs else "how", numeral(value), f"{criterion_name(study)} of {path}")
    on = "" if study.designs or len(study.candidates) == 1 else f", {path}"
    which = KeyNumber(f"which{facts.drawing_suffix(study)}", *_schedule_number(study, on))
    first = () if on else (how,)
    if not study.checks:
        return *first, which
    check = study.check(study.about, facts.CHOSEN).validation
    return (
        *first,
        which,
        KeyNumber(f"holds{facts.drawing_suffix(study)}", percent(check.in_band), f"of the instants with NEES in its band{on}"),
    )


def _schedule_number(study: Study, on: str) -> tuple[str, str]:
    """The number that stands for a schedule, and what it is: what keeping the requirements costs where that is asked, else the gap."""
    selection = study.selection
    if selection.question == "cheapest" and selection.cheapest is not None:
        schedule = selection.cheapest.schedule
        if schedule.status.has_answer:
            return numeral(schedule.value), f"cost of the cheapest schedule that keeps what is required, to within {asked_gap(study)}{on}"
        proven = "" if schedule.status is Status.INFEASIBLE else " was found that"
        return "none", f"no schedule{proven} keeps what is required{on}"
    return asked_gap(study), f"gap between schedule and bound{on}"


def _headline_of_flight(study: Study) -> tuple[KeyNumber, ...]:
    if study.flight is None:
        return ()
    return (KeyNumber("flight", f"{sum(study.flight.feasible)} of {len(study.flight.feasible)}", "plans in flight keep every limit"),)


def _study_answer(study: Study) -> str:
    """Answer the study's question in one sentence: the errors at the end, against flying and measuring without thinking."""
    if not study.checks:
        return capitalise(schedule_in_words(study)) + "."
    changes, check = facts.final_changes(study), study.check(study.about, facts.CHOSEN)
    better = [change for change in changes if change.is_better]
    verdict = "Yes" if better and check.validation.consistent else "In part"
    chosen = schedule_in_words(study)
    if study.selection.question_in_use == "cheapest":
        chosen = f"the cheapest schedule that keeps what is required, {chosen}"
    how = f"on {path_in_words(study.about)}, with {chosen}, a filter ends up"
    than = f"{path_in_words(study.baseline)} with {facts.baseline(study).schedule}"
    if not study.designs:
        than = facts.baseline(study).schedule
    if not better:
        return f"{verdict}: {how} with errors no smaller than {'on' if study.designs else 'with'} {than}{_consistency_clause(check)}."
    gains = join([f"{change.signal.name} to {with_unit(change.error, change.signal)}" for change in better])
    losses = join([with_unit(change.baseline_error, change.signal) for change in better])
    return f"{verdict}: {how} knowing {gains} (RMSE), where {than} leaves {losses}{_error_price(study)}{_consistency_clause(check)}."


def _error_price(study: Study) -> str:
    worse = [change for change in facts.final_changes(study) if change.is_worse]
    parts = [
        f"{change.signal.name} of {with_unit(change.error, change.signal)} instead of {with_unit(change.baseline_error, change.signal)}"
        for change in worse
    ]
    return f"; the price is an error in {join(parts)} at the end" if worse else ""


def _consistency_clause(check: FilterCheck) -> str:
    return "" if check.validation.consistent else f"; but the filter is {check.validation.verdict}"
