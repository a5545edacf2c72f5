"""Does it hold? What a filter makes of the path and the schedule."""

from __future__ import annotations

import numpy as np

from obsdesign.estimation.validation import CONSISTENT_SHARE
from obsdesign.report import derived_quantities as facts
from obsdesign.report.figures import error_histories, nees
from obsdesign.report.names import capitalise, minimised_in_words, path_in_words, path_suffix
from obsdesign.report.number_format import NARROW, display_unit, join, numeral, percent, plain, signal_label
from obsdesign.report.section import Section
from obsdesign.report.table import Entry, Table, TableColumn, Toned, hundredths, tabulate
from obsdesign.study.record import FilterCheck, Study


def section(study: Study) -> Section:
    """Return the answer to "Does it hold?"."""
    key, question = f"holds{facts.drawing_suffix(study)}", f"Does it hold?{path_suffix(study)}"
    pictures = (error_histories.picture(study), nees.picture(study))
    return Section(key, question, answer(study), pictures, (checks_table(study),), consistency_notes(study))


def checks_table(study: Study) -> Table:
    """Final errors, their bounds, and consistency for every path and schedule."""
    low, high = study.checks[0].validation.nees_interval
    runs = study.checks[0].validation.runs
    return tabulate(
        f"Filter errors at the end, {runs} runs each",
        "Good: a small error, close to its posterior Cramér-Rao bound (1σ, in brackets), and a consistent filter: run-averaged NEES in its "
        f"95{NARROW}% band, {numeral(low)} to {numeral(high)}, at {plain(100 * CONSISTENT_SHARE)}{NARROW}% or more of the instants after "
        f"{plain(facts.settling_time(study))}{NARROW}s.",
        (
            TableColumn("path"),
            TableColumn("schedule"),
            *(TableColumn(signal_label(signal)) for signal in facts.states_of(study)),
            TableColumn("in the band [%]", hundredths),
            TableColumn("highest NEES [–]"),
            TableColumn("filter"),
        ),
        (_check_row(study, check) for check in study.checks),
    )


def _check_row(study: Study, check: FilterCheck) -> tuple[Entry, ...]:
    validation = check.validation
    pairs = zip(validation.rmse[-1], validation.bound[-1], facts.states_of(study), strict=True)
    return (
        check.path,
        check.schedule,
        *(f"{numeral(rmse * display_unit(signal)[0])} ({numeral(bound * display_unit(signal)[0])})" for rmse, bound, signal in pairs),
        validation.in_band,
        facts.nees_peak(check)[0],
        Toned(validation.verdict, "good" if validation.consistent else "bad"),
    )


def answer(study: Study) -> str:
    """Answer "Does it hold?": consistency on the designed path, and what the chosen schedule is worth at the end."""
    check = study.check(study.about, facts.CHOSEN)
    validation, after = check.validation, f"{plain(facts.settling_time(study))}{NARROW}s"
    yes = "Yes" if validation.consistent else "Not quite"
    band = f"the run-averaged NEES lies in its 95{NARROW}% band at {percent(validation.in_band)} of the instants after {after}"
    excess = float(np.max(validation.rmse[-1] / validation.bound[-1])) - 1
    near = f"its final errors are at most {percent(max(excess, 0.0))} above their Cramér-Rao bounds"
    others = [case for case in study.checks if not case.validation.consistent and case is not check]
    rest = join(
        [f"{path_in_words(case.path)} with {_schedule_name(case.schedule)}" for case in others],
        "or" if not validation.consistent else "and",
    )
    contrast = "not so on" if validation.consistent else "nor is it consistent on"
    tail = f"; {contrast} {rest}" if others else ""
    return f"{yes}: on {path_in_words(study.about)} with the chosen schedule the filter is {validation.verdict}, {band}, and {near}{tail}."


def consistency_notes(study: Study) -> tuple[str, ...]:
    """Say for each case why its filter is not consistent, or what its NEES does at first."""
    notes = [f"{capitalise(check.path)}, {check.schedule}: {_reason(study, check)}" for check in study.checks if _reason(study, check)]
    worse = [change.signal.name for change in facts.final_changes(study) if change.is_worse]
    last = study.selection.chosen[-1]
    if worse and not last.all():
        on = join([name for name, is_on in zip(study.scenario.sensor_names, last, strict=True) if is_on])
        notes.append(
            f"The final error in {join(worse)} is larger than {_on_the_baseline(study)}with "
            f"{facts.baseline(study).schedule}: the schedule is chosen for {_purpose(study)}, and the last segment has only {on}."
        )
    return tuple(notes)


def _reason(study: Study, check: FilterCheck) -> str:
    validation, hidden = check.validation, facts.hidden_states(study, check)
    highest, when = facts.nees_peak(check)
    early = when < facts.settling_time(study)
    cause = "when the first measurements meet an estimate as far off as the prior allows" if early else "where the estimate is far off"
    peaks = f"the NEES peaks at {numeral(highest)} at {plain(when)}{NARROW}s, {cause}"
    if validation.verdict == "underconfident":
        return "underconfident: the covariance is larger than the errors, so measurements weigh less than they could."
    if validation.verdict == "overconfident" and hidden:
        return (
            f"overconfident, because these sensors do not see a combination of {join(hidden)} on this path; the filter linearises about "
            "estimates that move, and so gains information about that combination that is not there."
        )
    if validation.verdict == "overconfident":
        return f"overconfident: {peaks}, and the linearisation error of that moment is not forgotten in time."
    if early and highest > 1.5 * validation.nees_interval[1]:
        return f"{peaks}; the linearisation error of that moment is forgotten later."
    return ""


def _purpose(study: Study) -> str:
    if study.selection.question_in_use == "cheapest":
        return "the least cost at which what is required is kept"
    if study.selection.question_in_use == "filter":
        return minimised_in_words(study.scenario)
    return "what the whole path says about the start state, not for the last instant"


def _on_the_baseline(study: Study) -> str:
    return f"on {path_in_words(study.baseline)} " if study.designs else ""


def _schedule_name(schedule: str) -> str:
    return "the chosen schedule" if schedule == facts.CHOSEN else schedule
