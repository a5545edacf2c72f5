"""The cheapest schedule that keeps what is required: what it costs, what is proven, and which requirement leaves no room where."""

from __future__ import annotations

import numpy as np

from obsdesign.report.names import capitalise, path_in_words, requirement_in_words
from obsdesign.report.number_format import NARROW, join, numeral, percent, plain, typeset, with_unit
from obsdesign.report.table import Entry, Table, TableColumn, Toned, finite, tabulate
from obsdesign.selection.posterior.requirement import RequiredKnowledge
from obsdesign.signals import Signal
from obsdesign.status import Status
from obsdesign.study.rated_schedules import ALL_ON, FOR, CheapestAnswer
from obsdesign.study.record import Study


def cheapest_answer(study: Study, answer: CheapestAnswer) -> str:
    """Say what is required, what keeping it costs, how far that is proven, and what binds; or why nothing keeps it."""
    required = join([requirement_in_words(required) for required in answer.required])
    schedule = answer.schedule
    if schedule.status is Status.INFEASIBLE:
        return f"Required is {required}. {capitalise(typeset(schedule.notes[0]))}.{_instead(study)}"
    if not schedule.status.has_answer:
        return f"Required is {required}. No schedule was found that keeps it, and none is proven not to exist.{_instead(study)}"
    nearest = answer.nearest
    return (
        f"Required is {required}. The cheapest schedule found costs {numeral(schedule.value)}; {_certificate(answer)}. "
        f"What binds is {requirement_in_words(nearest)}: it comes to {size_in_words(study, nearest, schedule.predicted)}."
    )


def _instead(study: Study) -> str:
    return f" What is shown and run instead is the schedule {FOR['filter']}." if study.selection.question == "cheapest" else ""


def _certificate(answer: CheapestAnswer) -> str:
    schedule = answer.schedule
    if schedule.bound >= schedule.value:
        return "none that keeps it costs less, which is proven"
    proof = f"none that keeps it costs less than {numeral(schedule.bound)}, which is proven"
    return proof if schedule.status is Status.OPTIMAL else f"{proof}, so that it may be cheaper by up to {percent(schedule.gap)}"


def size_in_words(study: Study, required: RequiredKnowledge, predicted: np.ndarray) -> str:
    """Return the size on which it depends whether a requirement is kept, and when that is: 7.9 m at 83 s."""
    size, k = required.worst(predicted)
    return f"{with_unit(size, Signal('', required.unit))} at {plain(float(study.main.path.t[k]))}{NARROW}s"


def requirements_table(study: Study, answer: CheapestAnswer) -> Table:
    """What is required, and what it comes to with the cheapest schedule, with the one for the filter, and with all on."""
    ratings = () if study.selection.filter is None else study.selection.filter.rated
    shown = [rated for name in (FOR["cheapest"], FOR["filter"], ALL_ON) for rated in ratings if rated.name == name]

    def cell(required: RequiredKnowledge, predicted: np.ndarray) -> Toned:
        """Return the size that counts and when that is, good where the requirement is kept."""
        return Toned(size_in_words(study, required, predicted), "good" if required.holds(predicted) else "bad")

    rows: list[tuple[Entry, ...]] = [
        (
            requirement_in_words(required),
            f"{plain(required.misses)} of {plain(int(required.counted.sum()))}",
            *(cell(required, rated.predicted) for rated in shown),
        )
        for required in answer.required
    ]
    return tabulate(
        f"What is required, on {path_in_words(study.about)}",
        "Good: within the limit. The size is the largest but those at the instants that may be above it.",
        (TableColumn("requirement"), TableColumn("instants that may fail"), *(TableColumn(rated.name) for rated in shown)),
        rows,
    )


def expenses_table(study: Study, answer: CheapestAnswer) -> Table:
    """What schedules cost that keep the requirements, and which do not keep them."""
    schedule = answer.schedule
    rows: list[tuple[Entry, ...]] = [("none is below", schedule.bound), (FOR["cheapest"], Toned(schedule.value, "good"))]
    rows += [(rival.name, rival.value if np.isfinite(rival.value) else "breaks what is required") for rival in schedule.compared]
    return tabulate(
        f"What it costs to keep what is required, on {path_in_words(study.about)}",
        f"Good: low. {expense_in_words(study)}.",
        (TableColumn("schedule"), TableColumn("cost [–]", finite)),
        rows,
    )


def expense_in_words(study: Study) -> str:
    """Say what is counted: what sensors cost per segment that they are on, and per switching-on."""
    settings = study.scenario.selection
    per_segment = "each sensor 1" if settings.cost is None else _amounts(settings.cost)
    start = f"; switched on: {_amounts(settings.start)}" if any(settings.start.values()) else ""
    return f"Per segment of {plain(study.scenario.time.segment)}{NARROW}s on: {per_segment}{start}"


def _amounts(amounts: dict[str, float]) -> str:
    return ", ".join(f"{name} {plain(number)}" for name, number in amounts.items() if number) or "nothing"


def cheapest_notes(answer: CheapestAnswer) -> tuple[str, ...]:
    """Say what the proof says, and what the search has to say."""
    schedule = answer.schedule
    if not schedule.status.has_answer:
        return ()
    proof = (
        "The cheapest schedule: what it costs is what its sensors cost in the segments that they are on and as they are switched on. "
        f"Proven (by {typeset(schedule.bound_by)}) is that every schedule that costs less than {numeral(schedule.bound)} breaks a rule or "
        "a requirement, even for a filter that is granted more on the way than any schedule can teach it."
    )
    return (proof, *(f"{typeset(capitalise(note.rstrip('.')))}." for note in schedule.notes))
