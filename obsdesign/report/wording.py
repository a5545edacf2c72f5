"""Sentences made from numbers: the answers, and why a number is not better."""

from __future__ import annotations

import numpy as np

from obsdesign.report import derived_quantities as facts
from obsdesign.report.names import criterion_name, path_in_words
from obsdesign.report.number_format import NARROW, join, numeral, percent, plain, typeset, with_unit
from obsdesign.scenario.schema import DESIGNED, STRAIGHT, WEAVE
from obsdesign.signals import DEGREES_PER_RADIAN
from obsdesign.study.record import FilterCheck, Study

_FEW = 2  # manoeuvres that are told one by one


def study_answer(study: Study) -> str:
    """Answer the study's question in one sentence: the errors at the end, against flying and measuring without thinking."""
    if not study.checks:
        return _capitalise(schedule_in_words(study)) + "."
    changes, check = facts.final_changes(study), study.check(study.about, facts.CHOSEN)
    better = [change for change in changes if change.is_better]
    verdict = "Yes" if better and check.validation.consistent else "In part"
    how = f"on {path_in_words(study.about)}, with {schedule_in_words(study)}, a filter ends up"
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


def schedule_in_words(study: Study) -> str:
    """Say how many sensors are on at a time, and for how long each."""
    count, sensors = study.scenario.selection.per_segment, len(study.scenario.sensors)
    on = facts.on_times(study, study.selection.schedule.chosen)
    times = ", ".join(f"{name} {plain(seconds)}{NARROW}s" for name, seconds in on.items())
    return f"{count} of {sensors} sensors on at a time ({times})"


def observability_answer(study: Study) -> str:
    """Answer "Can it?": who sees everything, in which manoeuvre, and what the reported suites miss."""
    n, manoeuvres = len(study.scenario.state_names), dict.fromkeys(analysis.manoeuvre for analysis in study.analyses)
    missing = [
        f"{_misses(study, suite)} {'' if analysis.verdict.decided else 'up to '}{n - analysis.verdict.dimension} of {n} "
        f"dimensions, within {join(analysis.verdict.unobservable_states)} ({analysis.manoeuvre})"
        for suite in study.suites
        for analysis in facts.unobservable_analyses(study, suite)
    ]
    who = _suites_text(study, tuple(manoeuvres)) if len(manoeuvres) <= _FEW else _manoeuvres_text(study, tuple(manoeuvres))
    yes = "No" if len(facts.unobservable_analyses(study, study.suites[0])) == len(manoeuvres) else "Yes"
    return f"{yes}: {who}{f'; {join(missing)}' if missing else ''}."


def _suites_text(study: Study, manoeuvres: tuple[str, ...]) -> str:
    """How many combinations of sensors see everything in each manoeuvre."""
    parts = []
    for manoeuvre in manoeuvres:
        verdicts = [analysis.verdict for analysis in study.analyses if analysis.manoeuvre == manoeuvre]
        parts.append(f"{sum(verdict.observable for verdict in verdicts)} of {len(verdicts)} ({manoeuvre})")
    return f"of the combinations of sensors, {join(parts)} see all {len(study.scenario.state_names)} states"


def _manoeuvres_text(study: Study, manoeuvres: tuple[str, ...]) -> str:
    """In which manoeuvres all sensors together see everything."""
    unobservable = {analysis.manoeuvre for analysis in facts.unobservable_analyses(study, study.suites[0])}
    good = [name for name in manoeuvres if name not in unobservable]
    names = f" ({join(good)})" if good else ""
    return f"all sensors together see all {len(study.scenario.state_names)} states in {len(good)} of {len(manoeuvres)} manoeuvres{names}"


def _misses(study: Study, suite: tuple[str, ...]) -> str:
    together = set(suite) == set(study.scenario.sensor_names) and len(suite) > 1
    return "they miss" if together else f"{facts.sensors_in_words(study, suite)} misses"


def proof_note(study: Study) -> str:
    """Say how the dimensions were decided."""
    undecided = [analysis for analysis in study.analyses if not analysis.verdict.decided]
    how = "Dimensions are decided in ball arithmetic, which encloses every rounding error, not read off floating-point singular values."
    total = len(study.analyses)
    count = f"{len(undecided)} of {total} are undecided (marked ≥)" if undecided else f"All {total} are decided"
    shown = (*(analysis for suite in study.suites for analysis in facts.unobservable_analyses(study, suite)), *study.analyses)[0]
    who = f"{facts.sensors_in_words(study, shown.sensors)}, {shown.manoeuvre}"
    return f"{how} {count}. For {who}: {typeset(shown.verdict.proof)}."


def path_answer(study: Study) -> str:
    """Answer "How?": the designed path against constant inputs and the weave."""
    ours, path_names = _value(study, DESIGNED), {candidate.name for candidate in study.candidates}
    names = dict.fromkeys((study.baseline, *(baseline.name for baseline in study.scenario.baselines), STRAIGHT, WEAVE))
    rivals = [f"{_gain(study, ours, _value(study, name))} {path_in_words(name)}" for name in names if name in path_names]
    design, name = study.designs[0], criterion_name(study)
    return (
        f"Take the coloured path: with all sensors on, {name} is {numeral(ours)}, {join(rivals)}; "
        f"it is {design.status.value}, not proven global."
    )


def rating_answer(study: Study) -> str:
    """Say how much all sensors know on each given path."""
    name = criterion_name(study)
    values = [f"{numeral(_value(study, candidate.name))} on {path_in_words(candidate.name)}" for candidate in study.candidates]
    return f"With all sensors on, {name} is {join(values)}."


def _value(study: Study, path: str) -> float:
    return facts.value_of(study, study.candidate(path).qualities[0])


def _gain(study: Study, ours: float, theirs: float) -> str:
    """Compare two values of the criterion in words that suit it."""
    if not study.scenario.criterion.scales_with_information or ours * theirs <= 0 or not np.isfinite(theirs):
        return f"against {numeral(theirs)} for"
    if ours < 0:
        return f"{numeral(theirs / ours)} times nearer to 0 than for"
    return f"{numeral(ours / theirs)} times that of"


def cap_notes(study: Study) -> tuple[str, ...]:
    """Say for each suite how near its designed path comes to what no path can exceed, and why the others stay below."""
    return tuple(_cap(study, i) for i in range(len(study.suites))) if facts.judged_by_eigenvalue(study) else ()


def _cap(study: Study, i: int) -> str:
    suite, design, cap = facts.sensors_in_words(study, study.suites[i]), study.designs[i], study.designs[i].cap
    if cap is None:
        return f"With {suite}: no cap is known, since every part of the information depends on the path."
    block = ", ".join(cap.states)
    what = f"With {suite}: the information about ({block}) is the same on every path, so no path exceeds the cap {numeral(cap.value)}"
    relation = "reaches it" if design.reaches_cap else f"stays {percent(1 - design.value / cap.value)} below it"
    same = [candidate for candidate in study.candidates if candidate.duration == design.problem.longest]
    below = [candidate for candidate in same if candidate.qualities[i].value < cap.value * (1 - 1e-6)]
    reasons = [f"{candidate.name} {percent(facts.outside_share(study, candidate.qualities[i], cap))}" for candidate in below]
    lean = "A path stays below where its weakest direction leans on states outside that block; share outside"
    return f"{what}; the path designed for {suite} {relation}." + (f" {lean}: {', '.join(reasons)}." if below else "")


def weave_in_words(study: Study) -> str:
    """Describe the weave that was found, or say that there is none."""
    weave = study.weave
    if weave is None and "turn_rate" not in study.scenario.system.model.input_names:
        return "The vehicle has no turn rate: there is no weave to compare with."
    if weave is None:
        return "No weave meets the same limits: there is none to compare with."
    degrees, side = DEGREES_PER_RADIAN, "left" if weave.side > 0 else "right"
    return (
        f"The weave turns by {numeral(weave.course * degrees)}{NARROW}deg in the first 5{NARROW}s, then swings by "
        f"±{numeral(weave.swing * degrees)}{NARROW}deg with a period of {numeral(weave.period)}{NARROW}s, {side} first; "
        "course, swing, period and side are the best of a search over a grid that is refined about its best points."
    )


def validation_answer(study: Study) -> str:
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
    notes = [f"{_capitalise(check.path)}, {check.schedule}: {_reason(study, check)}" for check in study.checks if _reason(study, check)]
    worse = [change.signal.name for change in facts.final_changes(study) if change.is_worse]
    last = study.selection.schedule.chosen[-1]
    if worse and not last.all():
        on = join([name for name, is_on in zip(study.scenario.sensor_names, last, strict=True) if is_on])
        notes.append(
            f"The final error in {join(worse)} is larger than {_on_the_baseline(study)}with "
            f"{facts.baseline(study).schedule}: the schedule is chosen for what the whole path says about the start state, not for the "
            f"last instant, and the last segment has only {on}."
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


def _on_the_baseline(study: Study) -> str:
    return f"on {path_in_words(study.baseline)} " if study.designs else ""


def _schedule_name(schedule: str) -> str:
    return "the chosen schedule" if schedule == facts.CHOSEN else schedule


def _capitalise(text: str) -> str:
    return text[:1].upper() + text[1:]
