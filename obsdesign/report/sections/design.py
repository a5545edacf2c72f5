"""How? The designed path against others, how it was found, and how much better another might be."""

from __future__ import annotations

import numpy as np

from obsdesign.design.record import Design
from obsdesign.report import derived_quantities as facts
from obsdesign.report.figures import clearance_histories, eigenvector_panels, input_histories, path_map, spectra
from obsdesign.report.names import criterion_name, path_in_words
from obsdesign.report.number_format import NARROW, join, numeral, percent, plain, rounded_up
from obsdesign.report.section import Section
from obsdesign.report.sections._paths import contributions_table, path_value, paths_table
from obsdesign.report.table import Table, TableColumn, Toned, tabulate
from obsdesign.scenario.path_names import DESIGNED, STRAIGHT, WEAVE
from obsdesign.signals import DEGREES_PER_RADIAN
from obsdesign.study.record import Study

_MAX_NAMED = 4  # optima that are named
_LOOSE = 0.5  # share of the value: a bound farther away says nothing that helps
_TINY = 1e-5  # share of the value: what is less is told as that much


def section(study: Study) -> Section:
    """Return the answer to "How?"."""
    figures = (path_map, spectra, clearance_histories, eigenvector_panels, input_histories)
    pictures = tuple(picture for figure in figures if (picture := figure.picture(study)) is not None)
    starts = tuple(starts_table(study, i) for i in range(len(study.suites)))
    notes = (*(design_in_words(study, i) for i in range(len(study.suites))), *_cap_notes(study), _weave_note(study))
    return Section("how", "How?", _answer(study), pictures, (paths_table(study), contributions_table(study), *starts), notes)


def _answer(study: Study) -> str:
    """Answer "How?": the designed path against constant inputs and the weave."""
    ours, path_names = path_value(study, DESIGNED), {candidate.name for candidate in study.candidates}
    names = dict.fromkeys((study.baseline, *(baseline.name for baseline in study.scenario.baselines), STRAIGHT, WEAVE))
    rivals = [f"{_gain(study, ours, path_value(study, name))} {path_in_words(name)}" for name in names if name in path_names]
    design, name = study.designs[0], criterion_name(study)
    return f"Take the coloured path: with all sensors on, {name} is {numeral(ours)}, {join(rivals)}; {_standing(design)}."


def _standing(design: Design) -> str:
    """Say what is proven of all other paths, where that is not too loose to help; the notes give any bound."""
    if not np.isfinite(design.bound) or _excess(design) > _LOOSE:
        return "it is the best of the solver's starts: that no other is much better is not proven"
    return f"{_others(design)}, and that is proven"


def _excess(design: Design) -> float:
    """By how much of its value another path may be better."""
    return (design.bound - design.value) / abs(design.value) if design.value else np.inf


def _others(design: Design) -> str:
    """How much better another path may be at most, where there is a bound."""
    if design.gap <= 0:  # but for rounding
        return "no path is better"
    if not design.problem.criterion.scales_with_information:
        return f"no path is above {numeral(rounded_up(design.bound, 5), 5)}"
    return f"no path is better by more than {percent(rounded_up(max(_excess(design), _TINY)))}"


def _gain(study: Study, ours: float, theirs: float) -> str:
    """Compare two values of the criterion in words that suit it."""
    if not study.scenario.criterion.scales_with_information or ours * theirs <= 0 or not np.isfinite(theirs):
        return f"against {numeral(theirs)} for"
    if ours < 0:
        return f"{numeral(theirs / ours)} times nearer to 0 than for"
    return f"{numeral(ours / theirs)} times that of"


def _cap_notes(study: Study) -> tuple[str, ...]:
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


def _weave_note(study: Study) -> str:
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


def starts_table(study: Study, suite: int) -> Table:
    """What each start of the solver came to for one suite."""
    design, words = study.designs[suite], facts.sensors_in_words(study, study.suites[suite])
    name, best = _objective_name(study), design.objective - 1e-6 * abs(design.objective)
    rows = (
        (
            start.name,
            Toned(start.value, "good" if start.refined and start.value >= best else ""),
            start.iterations,
            Toned(start.status.value if start.refined else f"{start.status.value}, coarse", "" if start.status.has_answer else "bad"),
        )
        for start in design.starts
    )
    return tabulate(
        f"Starts of the solver, designed for {words}",
        f"Good: large {name}, and several starts that agree on it. The best (green) is taken; each is a local optimum at best.",
        (TableColumn("start"), TableColumn(f"{name} [–]"), TableColumn("iterations [–]", plain), TableColumn("status")),
        rows,
    )


def design_in_words(study: Study, i: int) -> str:
    """Say of the design for a suite what its starts came to, and what else is known about it."""
    design, who = study.designs[i], facts.sensors_in_words(study, study.suites[i])
    parts = (
        _optima(design),
        _duration(study, design),
        _prices(study, design),
        _robustness(study, design),
        _proof(design),
        _search(design),
        _evidence(study, design),
    )
    return f"Designed for {who}: {' '.join(filter(None, parts))}"


def _objective_name(study: Study) -> str:
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


def _proof(design: Design) -> str:
    """Say what no path exceeds, which paths that is about, and what the bound made no use of."""
    proof = design.proof
    if not np.isfinite(proof.bound):
        return f"No bound on other paths is proven: {proof.reason}." if proof.reason else ""
    left_out = f" It makes no use of: {join(proof.left_out)}." if proof.left_out else ""
    why = f" A nearer one was looked for: {proof.reason}." if proof.reason else ""
    return f"Proven: {_others(design)}, of {proof.class_of_paths}; the bound is {numeral(rounded_up(proof.bound, 5), 5)}.{left_out}{why}"


def _search(design: Design) -> str:
    """Say how the search ended, where a gap was asked for."""
    return "" if design.search is None else f"The search: {design.search.in_words(design)}."


def _evidence(study: Study, design: Design) -> str:
    evidence = design.evidence
    if evidence is None:
        return ""
    return (
        f"How much better might another path be? {plain(evidence.climbs)} climbs along the dual question met no path above "
        f"{numeral(evidence.estimate)}: as far as they tell, none has a {criterion_name(study)} that is better by more than "
        f"{percent(evidence.remaining / (1 - evidence.remaining) if evidence.remaining < 1 else 1.0)}. That is evidence, not proof."
    )
