"""Sentences made from numbers: the answers, and why a number is not better."""

from __future__ import annotations

import numpy as np

from obsdesign.report import derived_quantities as facts
from obsdesign.report.names import CRITERIA, path_in_words
from obsdesign.report.number_format import NARROW, joined, percent, plain, polished, rounded, with_unit
from obsdesign.scenario.schema import DESIGNED, STRAIGHT, WEAVE
from obsdesign.study.record import Check, Study

_FEW = 2  # manoeuvres that are told one by one


def criterion_name(study: Study) -> str:
    """Return what the value of a path is called."""
    kind, about = study.scenario.design.criterion, study.scenario.design.about
    name = CRITERIA.get(kind, kind.replace("_", " "))
    return f"{name} about {', '.join(about)}" if about else name


def answer(study: Study) -> str:
    """Answer the study's question in one sentence: the errors at the end, against flying and measuring without thinking."""
    if not study.checks:
        return _capital(schedule_in_words(study)) + "."
    changes, check = facts.final_changes(study), study.check(study.about, facts.CHOSEN)
    better = [change for change in changes if change.is_better]
    seen = "Yes" if better and check.validation.consistent else "In part"
    how = f"on {path_in_words(study.about)}, with {schedule_in_words(study)}, a filter ends up"
    than = f"{path_in_words(study.baseline)} with {facts.baseline(study).schedule}"
    if not study.designs:
        than = facts.baseline(study).schedule
    if not better:
        return f"{seen}: {how} with errors no smaller than {'on' if study.designs else 'with'} {than}{_honesty(check)}."
    gains = joined([f"{change.signal.name} to {with_unit(change.ours, change.signal)}" for change in better])
    losses = joined([with_unit(change.theirs, change.signal) for change in better])
    return f"{seen}: {how} knowing {gains} (RMSE), where {than} leaves {losses}{_price(study)}{_honesty(check)}."


def _price(study: Study) -> str:
    worse = [change for change in facts.final_changes(study) if change.is_worse]
    parts = [
        f"{change.signal.name} of {with_unit(change.ours, change.signal)} instead of {with_unit(change.theirs, change.signal)}"
        for change in worse
    ]
    return f"; the price is an error in {joined(parts)} at the end" if worse else ""


def _honesty(check: Check) -> str:
    return "" if check.validation.consistent else f"; but the filter is {check.validation.verdict}"


def schedule_in_words(study: Study) -> str:
    """Say how many sensors are on at a time, and for how long each."""
    count, sensors = study.scenario.selection.per_segment, len(study.scenario.sensors)
    on = facts.sensors_on(study, study.selection.schedule.chosen)
    times = ", ".join(f"{name} {plain(seconds)}{NARROW}s" for name, seconds in on.items())
    return f"{count} of {sensors} sensors on at a time ({times})"


def seen(study: Study) -> str:
    """Answer "Can it?": who sees everything, in which manoeuvre, and what the reported suites miss."""
    n, manoeuvres = len(study.scenario.state_names), dict.fromkeys(each.manoeuvre for each in study.analyses)
    missing = [
        f"{_misses(study, suite)} {'' if each.verdict.decided else 'up to '}{n - each.verdict.dimension} of {n} "
        f"dimensions, within {joined(each.verdict.unobservable_states)} ({each.manoeuvre})"
        for suite in study.suites
        for each in facts.incomplete(study, suite)
    ]
    who = _who_sees(study, tuple(manoeuvres)) if len(manoeuvres) <= _FEW else _where_seen(study, tuple(manoeuvres))
    yes = "No" if len(facts.incomplete(study, study.suites[0])) == len(manoeuvres) else "Yes"
    return f"{yes}: {who}{f'; {joined(missing)}' if missing else ''}."


def _who_sees(study: Study, manoeuvres: tuple[str, ...]) -> str:
    """How many combinations of sensors see everything in each manoeuvre."""
    parts = []
    for manoeuvre in manoeuvres:
        verdicts = [each.verdict for each in study.analyses if each.manoeuvre == manoeuvre]
        parts.append(f"{sum(verdict.observable for verdict in verdicts)} of {len(verdicts)} ({manoeuvre})")
    return f"of the combinations of sensors, {joined(parts)} see all {len(study.scenario.state_names)} states"


def _where_seen(study: Study, manoeuvres: tuple[str, ...]) -> str:
    """In which manoeuvres all sensors together see everything."""
    blind = {each.manoeuvre for each in facts.incomplete(study, study.suites[0])}
    good = [name for name in manoeuvres if name not in blind]
    names = f" ({joined(good)})" if good else ""
    return f"all sensors together see all {len(study.scenario.state_names)} states in {len(good)} of {len(manoeuvres)} manoeuvres{names}"


def _misses(study: Study, suite: tuple[str, ...]) -> str:
    together = set(suite) == set(study.scenario.sensor_names) and len(suite) > 1
    return "they miss" if together else f"{facts.sensors_in_words(study, suite)} misses"


def proven(study: Study) -> str:
    """Say how the dimensions were decided."""
    undecided = [each for each in study.analyses if not each.verdict.decided]
    how = "Dimensions are decided in ball arithmetic, which encloses every rounding error, not read off floating-point singular values."
    total = len(study.analyses)
    count = f"{len(undecided)} of {total} are undecided (marked ≥)" if undecided else f"All {total} are decided"
    shown = (*(each for suite in study.suites for each in facts.incomplete(study, suite)), *study.analyses)[0]
    who = f"{facts.sensors_in_words(study, shown.sensors)}, {shown.manoeuvre}"
    return f"{how} {count}. For {who}: {polished(shown.verdict.proof)}."


def taken(study: Study) -> str:
    """Answer "How?": the designed path against constant inputs and the weave."""
    ours, known = _value(study, DESIGNED), {candidate.name for candidate in study.candidates}
    names = dict.fromkeys((study.baseline, *(each.name for each in study.scenario.baselines), STRAIGHT, WEAVE))
    rivals = [f"{_gain(study, ours, _value(study, name))} {path_in_words(name)}" for name in names if name in known]
    design, name = study.designs[0], criterion_name(study)
    return (
        f"Take the coloured path: with all sensors on, {name} is {rounded(ours)}, {joined(rivals)}; "
        f"it is {design.status.value}, not proven global."
    )


def rated(study: Study) -> str:
    """Say how much all sensors know on each given path."""
    name = criterion_name(study)
    values = [f"{rounded(_value(study, each.name))} on {path_in_words(each.name)}" for each in study.candidates]
    return f"With all sensors on, {name} is {joined(values)}."


def _value(study: Study, path: str) -> float:
    return facts.value_of(study, study.candidate(path).qualities[0])


def _gain(study: Study, ours: float, theirs: float) -> str:
    """Compare two values of the criterion in words that suit it."""
    if study.scenario.design.criterion in ("log_det", "posterior") or theirs in (0.0, float("-inf")):
        return f"against {rounded(theirs)} for"
    if ours < 0:
        return f"a sum of variances {rounded(theirs / ours)} times smaller than for"
    return f"{rounded(ours / theirs)} times that of"


def caps(study: Study) -> tuple[str, ...]:
    """Say for each suite how near its designed path comes to what no path can exceed, and why the others stay below."""
    return tuple(_cap(study, i) for i in range(len(study.suites))) if facts.judged_by_eigenvalue(study) else ()


def _cap(study: Study, i: int) -> str:
    suite, design, cap = facts.sensors_in_words(study, study.suites[i]), study.designs[i], study.designs[i].cap
    if cap is None:
        return f"With {suite}: no cap is known, since every part of the information depends on the path."
    block = ", ".join(cap.states)
    what = f"With {suite}: the information about ({block}) is the same on every path, so no path exceeds the cap {rounded(cap.value)}"
    found = "reaches it" if design.reaches_cap else f"stays {percent(1 - design.value / cap.value)} below it"
    same = [candidate for candidate in study.candidates if candidate.duration == design.problem.longest]
    below = [candidate for candidate in same if candidate.qualities[i].value < cap.value * (1 - 1e-6)]
    reasons = [f"{candidate.name} {percent(facts.outside_share(study, candidate.qualities[i], cap))}" for candidate in below]
    lean = "A path stays below where its weakest direction leans on states outside that block; share outside"
    return f"{what}; the path designed for {suite} {found}." + (f" {lean}: {', '.join(reasons)}." if below else "")


def weave_in_words(study: Study) -> str:
    """Describe the weave that was found, or say that there is none."""
    weave = study.weave
    if weave is None and "turn_rate" not in study.scenario.system.model.input_names:
        return "The vehicle has no turn rate: there is no weave to compare with."
    if weave is None:
        return "No weave meets the same limits: there is none to compare with."
    degrees, side = 180 / np.pi, "left" if weave.side > 0 else "right"
    return (
        f"The weave turns by {rounded(weave.course * degrees)}{NARROW}deg in the first 5{NARROW}s, then swings by "
        f"±{rounded(weave.swing * degrees)}{NARROW}deg with a period of {rounded(weave.period)}{NARROW}s, {side} first; "
        "course, swing, period and side are the best of a search over a grid that is refined about its best points."
    )


def held(study: Study) -> str:
    """Answer "Does it hold?": consistency on the designed path, and what the chosen schedule is worth at the end."""
    check = study.check(study.about, facts.CHOSEN)
    validation, after = check.validation, f"{plain(facts.settled_after(study))}{NARROW}s"
    yes = "Yes" if validation.consistent else "Not quite"
    band = f"the run-averaged NEES lies in its 95{NARROW}% band at {percent(validation.in_band)} of the instants after {after}"
    excess = float(np.max(validation.rmse[-1] / validation.bound[-1])) - 1
    near = f"its final errors are at most {percent(max(excess, 0.0))} above their Cramér-Rao bounds"
    others = [each for each in study.checks if not each.validation.consistent and each is not check]
    rest = joined(
        [f"{path_in_words(each.path)} with {_named(each.schedule)}" for each in others], "or" if not validation.consistent else "and"
    )
    contrast = "not so on" if validation.consistent else "nor is it consistent on"
    tail = f"; {contrast} {rest}" if others else ""
    return f"{yes}: on {path_in_words(study.about)} with the chosen schedule the filter is {validation.verdict}, {band}, and {near}{tail}."


def reasons(study: Study) -> tuple[str, ...]:
    """Say for each case why its filter is not consistent, or what its NEES does at first."""
    found = [f"{_capital(check.path)}, {check.schedule}: {_reason(study, check)}" for check in study.checks if _reason(study, check)]
    worse = [change.signal.name for change in facts.final_changes(study) if change.is_worse]
    last = study.selection.schedule.chosen[-1]
    if worse and not last.all():
        on = joined([name for name, kept in zip(study.scenario.sensor_names, last, strict=True) if kept])
        found.append(
            f"The final error in {joined(worse)} is larger than {_on_the_baseline(study)}with "
            f"{facts.baseline(study).schedule}: the schedule is chosen for what the whole path says about the start state, not for the "
            f"last instant, and the last segment has only {on}."
        )
    return tuple(found)


def _reason(study: Study, check: Check) -> str:
    validation, hidden = check.validation, facts.hidden_under(study, check)
    highest, when = facts.peak(check)
    early = when < facts.settled_after(study)
    cause = "when the first measurements meet an estimate as far off as the prior allows" if early else "where the estimate is far off"
    peaks = f"the NEES peaks at {rounded(highest)} at {plain(when)}{NARROW}s, {cause}"
    if validation.verdict == "underconfident":
        return "underconfident: the covariance is larger than the errors, so measurements weigh less than they could."
    if validation.verdict == "overconfident" and hidden:
        return (
            f"overconfident, because these sensors do not see a combination of {joined(hidden)} on this path; the filter linearises about "
            "estimates that move, and so gains information about that combination that is not there."
        )
    if validation.verdict == "overconfident":
        return f"overconfident: {peaks}, and the linearisation error of that moment is not forgotten in time."
    if early and highest > 1.5 * validation.nees_interval[1]:
        return f"{peaks}; the linearisation error of that moment is forgotten later."
    return ""


def _on_the_baseline(study: Study) -> str:
    return f"on {path_in_words(study.baseline)} " if study.designs else ""


def _named(schedule: str) -> str:
    return "the chosen schedule" if schedule == facts.CHOSEN else schedule


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
