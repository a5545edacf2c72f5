"""Which? When each sensor is on and where, how good that is, what rules and losses cost."""

from __future__ import annotations

import math

import numpy as np

from obsdesign.report import derived_quantities as facts
from obsdesign.report.figures import (
    decision_costs,
    energy_front,
    path_map,
    predicted_errors,
    required_errors,
    rival_bars,
    schedule_raster,
    sensor_prices,
)
from obsdesign.report.figures.rival_bars import rival_values
from obsdesign.report.names import capitalise, gap_in_words, has_relative_gap, path_in_words, path_suffix, schedule_criterion
from obsdesign.report.number_format import NARROW, SUPERSCRIPT, join, numeral, plain, typeset
from obsdesign.report.section import Section
from obsdesign.report.sections._rules import rule_in_words
from obsdesign.report.sections._segment_traits import segment_traits, usage_in_words
from obsdesign.report.sections.cheapest_schedule import cheapest_answer, cheapest_notes, expenses_table, requirements_table
from obsdesign.report.sections.filter_schedule import filter_answer, filter_clause, filter_notes, questions_table
from obsdesign.report.table import Entry, Table, TableColumn, Toned, finite, hundredths, seconds, tabulate
from obsdesign.status import Status
from obsdesign.study.record import RivalSchedule, Study


def section(study: Study) -> Section:
    """Return the answer to "Which?"."""
    for_start, for_filter = (decision_costs, rival_bars, energy_front), (predicted_errors, sensor_prices)
    rated, cheapest = study.selection.filter, study.selection.cheapest
    ordered = (*for_start, *for_filter) if study.selection.question == "start" else (*for_filter, *for_start)
    figures = (*(() if study.designs else (path_map,)), schedule_raster, required_errors, *ordered)
    both = () if rated is None else (questions_table(study, rated),)
    required = () if cheapest is None else (requirements_table(study, cheapest), expenses_table(study, cheapest))
    losses = (losses_table(study),) if study.selection.losses else ()
    return Section(
        f"which{facts.drawing_suffix(study)}",
        f"Which?{path_suffix(study)}",
        answer(study),
        tuple(picture for figure in figures if (picture := figure.picture(study)) is not None),
        (*required, *both, usage_table(study), schedules_table(study), *losses),
        (
            *(() if cheapest is None else cheapest_notes(cheapest)),
            *(() if rated is None else filter_notes(study, rated)),
            *_method_notes(study),
        ),
    )


def answer(study: Study) -> str:
    """Answer "Which?": when and where each sensor is on, how far that is from the best, what the others reach."""
    schedule, name, rated = study.selection.schedule, schedule_criterion(study), study.selection.filter
    words, cheapest = f"{capitalise(schedule_in_words(study))}: {usage_in_words(study)}.", study.selection.cheapest
    words = words if cheapest is None else f"{words} {cheapest_answer(study, cheapest)}"
    if study.selection.question_in_use == "cheapest":
        return words
    if study.selection.question_in_use == "filter" and rated is not None:
        return f"{words} {filter_answer(study, rated, _schedule_count(study))}"
    others = join(
        [
            f"{rival.name} reaches {numeral(facts.zero_round_off(study, rival.value))}{_violation_clause(study, rival)}"
            for rival in study.selection.rivals
        ]
    )
    clause = "" if rated is None else filter_clause(study, rated)
    return f"{words} {name} is {numeral(schedule.value)}, {certificate(study)}; {others}.{clause}"


def certificate(study: Study) -> str:
    """Say how near to the best the schedule is: certified within 0.02 % of the best of 4^24 schedules."""
    schedule, is_difference = study.selection.schedule, not has_relative_gap(study)
    if schedule.status is Status.OPTIMAL:
        return f"proven to be the best of {_schedule_count(study)} but for a gap of {gap_in_words(study)}"
    return f"certified within {gap_in_words(study)} {'below' if is_difference else 'of'} the best of {_schedule_count(study)}"


def dependent_sensors(study: Study) -> list[str]:
    """Names of the sensors whose errors are not independent from sample to sample, or from each other."""
    samples = study.main.information.samples
    return [] if samples is None else [study.main.information.names[place] for place in samples.colour.sensor_indices]


def _schedule_count(study: Study) -> str:
    settings, sensors, segments = study.scenario.selection, len(study.scenario.sensor_names), len(study.selection.schedule.chosen)
    if settings.rules:
        return "all schedules that keep the rules"
    return f"{plain(math.comb(sensors, settings.per_segment))}{str(segments).translate(SUPERSCRIPT)} schedules"


def _violation_clause(study: Study, rival: RivalSchedule) -> str:
    total = len(study.scenario.selection.rules)
    count = "the rule" if total == 1 else f"{plain(len(rival.breaks))} of the {plain(total)} rules"
    return f" but breaks {count}" if rival.breaks else ""


def _method_notes(study: Study) -> tuple[str, ...]:
    """Say how the schedule was found, within which rules, and what went otherwise than planned."""
    schedule, settings = study.selection.schedule, study.scenario.selection
    undecided, segments = schedule.fractional, len(schedule.chosen)
    left = f"leaves {undecided} of {segments} segments undecided; these are rounded" if undecided else "decides every segment"
    looked = f" Branch and bound then looked at {plain(schedule.nodes)} partial schedules." if schedule.nodes else ""
    parts = [
        "What the schedule for the start maximises is information about the state at the start, from the samples alone: without process "
        "noise and without the prior.",
        f"It comes from a convex relaxation that {left}; exchanges of single sensors then improve it where they can.{looked} "
        "The bound follows from the relaxation's dual alone, so it holds whatever the solver did.",
    ]
    if study.selection.exact is not None:
        lasting = join(dependent_sensors(study))
        parts.append(
            f"The errors of {lasting} last or belong together, so that no amounts for single segments add up to what samples say together: "
            f"the schedule is chosen, and the bound proven, for amounts from below, which no schedule falls short of. All samples of the "
            f"chosen schedule together have a {schedule_criterion(study)} of {numeral(facts.zero_round_off(study, study.selection.exact))}."
        )
    if settings.rules:
        parts.append(f"Rules: {'; '.join(rule_in_words(rule) for rule in settings.rules)}.")
    if settings.robust_to:
        lost = "any one sensor" if settings.robust_to == 1 else f"any {plain(settings.robust_to)} sensors"
        parts.append(f"The schedule is chosen for the worst loss of {lost}: its value is what is then left.")
    parts += [
        f"{typeset(note[:1].upper() + note[1:])}." for note in (note_text.rstrip(".") for note_text in (*schedule.notes, *study.notes))
    ]
    return tuple(parts)


def schedule_in_words(study: Study) -> str:
    """Say how many sensors are on at a time, and for how long each."""
    count, sensors = study.scenario.selection.per_segment, len(study.scenario.sensor_names)
    on = facts.on_times(study, study.selection.chosen)
    times = ", ".join(f"{name} {plain(seconds)}{NARROW}s" for name, seconds in on.items())
    return f"{count} of {sensors} sensors on at a time ({times})"


def usage_table(study: Study) -> Table:
    """When and where each sensor is on."""
    traits, times = segment_traits(study), facts.segment_nodes(study)
    everything, on = np.ones(len(traits.seconds), dtype=bool), study.selection.chosen
    has_turns, has_beacons = traits.is_mixed, any(traits.has_beacon)

    def row(name: str, active: np.ndarray, near: np.ndarray | None) -> tuple[Entry, ...]:
        """Return the row of one sensor."""
        total = float(traits.seconds @ active)
        turns = (traits.share(active, traits.is_turning),) if has_turns else ()
        beacons = (math.nan if near is None else traits.share(active, near),) if has_beacons else ()
        return (name, total, total / (times[-1] - times[0]), *turns, *beacons)

    shares = " Shares are of a sensor's own time." if has_turns or has_beacons else ""
    near = " Near its beacon is nearer than half of the path." if has_beacons else ""
    columns = (TableColumn("in turns [%]", hundredths),) * has_turns + (TableColumn("near its beacon [%]", hundredths),) * has_beacons
    rows = [
        row(name, on[:, s], traits.is_near[:, s] if traits.has_beacon[s] else None) for s, name in enumerate(study.scenario.sensor_names)
    ]
    return tabulate(
        f"Where the sensors are on, {path_in_words(study.about).removeprefix('the ')}",
        f"Good: only what is needed.{shares}{near}",
        (TableColumn("sensor"), TableColumn("on [s]", seconds), TableColumn("of the path [%]", hundredths), *columns),
        (*rows, row("the path itself", everything, None)),
    )


def losses_table(study: Study) -> Table:
    """What is left when a sensor is lost."""
    name, value = schedule_criterion(study), study.selection.schedule.value
    rows = (
        (
            study.scenario.sensor_names[loss.sensor],
            _kept(study, loss.kept, value),
            *(facts.zero_round_off(study, left) for left in (loss.kept, loss.rechosen, loss.bound)),
        )
        for loss in study.selection.losses
    )
    share = TableColumn("kept" if _compares_differences(study) else "kept [%]", hundredths)
    values = (TableColumn(f"{name} kept [–]", finite), TableColumn(f"{name}, chosen anew [–]", finite), TableColumn("bound [–]", finite))
    return tabulate(
        "When a sensor is lost",
        f"Good: a schedule for the start that keeps most of its {name}, {numeral(value)}, whichever sensor fails. Kept: by this schedule "
        "without the sensor; chosen anew: by a schedule of the other sensors, none of which is above the bound.",
        (TableColumn("lost sensor"), share, *values),
        rows,
    )


def _compares_differences(study: Study) -> bool:
    """Whether differences of the criterion count, not shares, which no value below 0 has."""
    return not study.scenario.schedule_criterion.scales_with_information or study.selection.schedule.value < 0


def _kept(study: Study, kept_value: float, value: float) -> Entry:
    """What is left as a share where shares count, else in a word."""
    if not math.isfinite(kept_value) or (not _compares_differences(study) and facts.zero_round_off(study, kept_value) <= 0):
        return Toned("nothing", "bad")
    if _compares_differences(study):
        return "all" if kept_value >= value - 1e-9 * abs(value) else "less"
    return Toned(kept_value / value if value > 0 else math.nan, "good" if kept_value > 0.8 * value else "")


def schedules_table(study: Study) -> Table:
    """The criterion of the bound, the chosen schedule, the naive ones, and all sensors on throughout."""
    schedule, name = study.selection.schedule, schedule_criterion(study)
    values = {"no schedule is above": schedule.bound} | rival_values(study)
    if study.selection.exact is not None:
        values = {
            f"{facts.start_schedule_name(study)}, all its samples together": facts.zero_round_off(study, study.selection.exact)
        } | values
    total = study.problem.scaled(study.main.information.total)
    values["all sensors on, for comparison"] = study.scenario.schedule_criterion.value(total)
    bound = schedule.bound
    has_shares = study.scenario.schedule_criterion.scales_with_information and bound > 0
    rows = (
        (label, Toned(value, "good" if label == facts.start_schedule_name(study) else ""), *((value / bound,) if has_shares else ()))
        for label, value in values.items()
    )
    share = (TableColumn("of the bound [%]", hundredths),) if has_shares else ()
    return tabulate(
        f"Schedules for the start, on {path_in_words(study.about)}",
        f"Good: large {name} of S W S, near the bound that no schedule with {study.scenario.selection.per_segment} on at a time exceeds.",
        (TableColumn("schedule"), TableColumn(f"{name} [–]", finite), *share),
        rows,
        _schedule_notes(study),
    )


def _schedule_notes(study: Study) -> tuple[str, ...]:
    """Which rules rivals break, and which rows count amounts from below."""
    rules = study.scenario.selection.rules
    broken = tuple(
        f"* {rival.name} breaks: {'; '.join(rule_in_words(rule) for rule in rules if str(rule) in rival.breaks)}."
        for rival in study.selection.rivals
        if rival.breaks
    )
    if study.selection.exact is None:
        return broken
    return (*broken, f"The errors of {join(dependent_sensors(study))} last: all but the first and the last row count amounts from below.")
