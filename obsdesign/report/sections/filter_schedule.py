"""The schedule for the filter: what was minimised, what is proven, and every schedule under both questions."""

from __future__ import annotations

import math

import numpy as np

from obsdesign.report import derived_quantities as facts
from obsdesign.report.names import filter_gap, minimised_in_words, path_in_words, schedule_criterion
from obsdesign.report.number_format import NARROW, display_unit, join, numeral, plain, signal_label, typeset
from obsdesign.report.table import Entry, Table, TableColumn, Tone, Toned, finite, tabulate
from obsdesign.status import Status
from obsdesign.study.rated_schedules import ALL_ON, FOR, FilterAnswer
from obsdesign.study.record import CHOSEN, Study

_FORGOTTEN = 5  # half-lives after which a thirtieth is left


def filter_answer(study: Study, answer: FilterAnswer, how_many: str) -> str:
    """Say what was minimised, how far that is from the best, what other schedules cost, and for how long choices matter."""
    schedule, names = answer.schedule, (FOR["start"], study.selection.rivals[0].name, ALL_ON)
    others = [f"{_in_a_sentence(name)} costs {numeral(rated.cost)}" for name in names if (rated := answer.find(name)) is not None]
    return (
        f"What is minimised is {minimised_in_words(study.scenario)}, with each state in units of its standard deviation in the prior: "
        f"{numeral(schedule.value)}. No schedule is below {numeral(schedule.bound)}: {_certificate(study, answer, how_many)}; "
        f"{join(others)}. {memory_in_words(study, answer)}."
    )


def filter_clause(study: Study, answer: FilterAnswer) -> str:
    """Say what the schedule for the start costs a filter, where the start is what is asked."""
    rated = answer.find(FOR["start"])
    if rated is None or not answer.schedule.status.has_answer:
        return ""
    schedule = answer.schedule
    return (
        f" To a filter on the way it costs {numeral(rated.cost)}, where the schedule for the filter costs {numeral(schedule.value)} "
        f"and none is below {numeral(schedule.bound)}."
    )


def _in_a_sentence(name: str) -> str:
    return {FOR["start"]: "the schedule for the start", ALL_ON: "to have all on, were it allowed,"}.get(name, name)


def _certificate(study: Study, answer: FilterAnswer, how_many: str) -> str:
    gap = filter_gap(study, answer)
    if answer.schedule.status is Status.OPTIMAL:
        return f"this one is proven to be the best of {how_many} but for a gap of {gap}"
    return f"the best of {how_many} may be better by up to {gap}, which is as far as the proof came"


def memory_in_words(study: Study, answer: FilterAnswer) -> str:
    """Say for how long it matters what was on."""
    schedule = answer.schedule
    if not math.isfinite(schedule.memory):
        return "What is once learnt is not forgotten on this path: early choices matter to its end"
    half = schedule.memory * float(np.median(np.diff(schedule.boundaries)))
    gone, lead = _FORGOTTEN * half, f"Half of what a choice brings is forgotten after {plain(round(half, 9))}{NARROW}s"
    if gone >= study.main.duration:
        return f"{lead}, so that choices matter for much of the path"
    return f"{lead}: what was on {plain(round(gone, 9))}{NARROW}s ago no longer matters"


def questions_table(study: Study, answer: FilterAnswer) -> Table:
    """Each schedule under both questions, with the errors of the filter that ran with it."""
    name, schedule, signals = schedule_criterion(study), answer.schedule, facts.states_of(study)
    errors = _errors_on_the_way(study)

    def row(label: str, chosen_label: str, cost: float, information: float) -> tuple[Entry, ...]:
        """Return the row of a schedule; where no filter ran with it, without errors."""
        rmse = errors.get(label, np.full(len(signals), math.nan))
        cost_tone: Tone = "good" if label == FOR["filter"] else ""
        information_tone: Tone = "good" if label == FOR["start"] else ""
        shown = (factor * float(value) for value, factor in zip(rmse, (display_unit(signal)[0] for signal in signals), strict=True))
        known = Toned(facts.zero_round_off(study, information), information_tone)
        return (chosen_label, Toned(cost, cost_tone), known, *(shown if errors else ()))

    bounds = row("", "no schedule is better than", schedule.bound, study.selection.schedule.bound)
    rows = [row(each.name, f"{each.name}{' *' if each.breaks else ''}", each.cost, each.information) for each in answer.rated]
    columns = tuple(TableColumn(f"RMSE {signal_label(signal)}", finite) for signal in signals) if errors else ()
    runs = f" RMSE: over all instants of {study.checks[0].validation.runs} filter runs." if study.checks else ""
    return tabulate(
        f"Each schedule under both questions, on {path_in_words(study.about)}",
        f"Good: a low cost to the filter (on the way, with process noise and prior); for the start, a large {name}.{runs}",
        (TableColumn("schedule"), TableColumn("cost to the filter [–]", finite), TableColumn(f"{name} at the start [–]", finite), *columns),
        (bounds, *rows),
        ("* breaks rules.",) if any(each.breaks for each in answer.rated) else (),
    )


def _errors_on_the_way(study: Study) -> dict[str, np.ndarray]:
    """Root mean square errors (n,) over all instants with samples, by schedule, of the filters that ran on the path."""
    called = {CHOSEN: FOR[study.selection.question_in_use]}
    return {
        called.get(check.schedule, check.schedule): np.sqrt(np.mean(check.validation.rmse[:-1] ** 2, axis=0))
        for check in study.checks
        if check.path == study.about
    }


def filter_notes(study: Study, answer: FilterAnswer) -> tuple[str, ...]:
    """Say in plain words what the cost is, and what the proof says."""
    schedule = answer.schedule
    parts = [
        "The schedule for the filter: how large a filter's errors will be follows from the path, the prior, the process noise and what is "
        f"on when, before anything is measured. Proven (by {typeset(schedule.bound_by)}) is that no schedule that keeps the rules brings "
        f"the cost below {numeral(schedule.bound)}: even a filter that is granted more on the way than any schedule can "
        "teach it costs as much. A filter that linearises may do worse than predicted: see what it makes of it.",
    ]
    return (*parts, *(f"{typeset(note[:1].upper() + note[1:])}." for note in (text.rstrip(".") for text in schedule.notes)))
