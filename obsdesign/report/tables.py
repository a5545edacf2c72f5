"""The tables of the page: every column with its unit, every table with what is good in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from obsdesign.analysis.verdict import Verdict
from obsdesign.estimation.validation import CONSISTENT_SHARE
from obsdesign.information.contribution_shares import shortest_bulk
from obsdesign.report import derived_quantities as facts
from obsdesign.report.names import criterion_name, path_in_words, violations_in_words
from obsdesign.report.number_format import MINUS, NARROW, display_unit, numeral, plain, signal_label, typeset
from obsdesign.report.sections.design import objective_name
from obsdesign.signals import Signal
from obsdesign.study.record import Analysis, Candidate, FilterCheck, Quality, Study

DASH = "–"
Tone = Literal["", "good", "bad"]


@dataclass(frozen=True)
class Cell:
    """One cell: its text, and whether it is good or bad news."""

    text: str
    tone: Tone = ""


@dataclass(frozen=True)
class Table:
    """title; good: what is good in it; head: one text per column, with units; rows: the first cell of each names the row."""

    title: str
    good: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = ()

    def is_words(self, column: int) -> bool:
        """Whether a column holds words, to be set flush left: no cell of it begins with a number."""
        return not any(row[column].text[:2].strip(MINUS + "≥" + NARROW)[:1].isdigit() for row in self.rows)


def subsets_table(study: Study) -> Table:
    """Dimension of the observable space for every subset of the sensors and every manoeuvre, hidden directions as notes."""
    verdicts = {(analysis.sensors, analysis.manoeuvre): analysis.verdict for analysis in study.analyses}
    subsets, manoeuvres = dict.fromkeys(key[0] for key in verdicts), dict.fromkeys(key[1] for key in verdicts)
    hidden = tuple(dict.fromkeys(verdict.hidden for verdict in verdicts.values() if not verdict.observable))
    rows = tuple(
        (Cell(" + ".join(subset)), *(_dimension(verdicts[subset, manoeuvre], hidden) for manoeuvre in manoeuvres)) for subset in subsets
    )
    notes = tuple(f"{_letter(i)}{NARROW}: {typeset(text)}." for i, text in enumerate(hidden))
    n, letters = len(study.scenario.state_names), " Letters name what stays hidden." if hidden else ""
    return Table(
        "Dimension of the observable space",
        f"Good is {n} of {n}: every state can be found from the measurements.{letters}",
        ("sensors", *(f"{name} [dimensions]" for name in manoeuvres)),
        rows,
        notes,
    )


def hidden_table(study: Study, analysis: Analysis) -> Table:
    """The hidden directions of one suite in one manoeuvre as vectors."""
    space = analysis.verdict.null_space
    columns = range(space.shape[1])
    rows = tuple(
        (Cell(signal.name), *(Cell(_component(space[i, k], signal)) for k in columns)) for i, signal in enumerate(facts.states_of(study))
    )
    who = facts.sensors_in_words(study, analysis.sensors)
    return Table(
        f"What {who} cannot see, {analysis.manoeuvre}",
        "Good would be no direction at all. Moving the start state by any multiple of a column changes no measurement (to first order).",
        ("state", *(f"direction {k + 1}" for k in columns)),
        rows,
    )


def paths_table(study: Study) -> Table:
    """Value, smallest eigenvalues, Cramér-Rao bounds, feasibility and cap of every path for every suite."""
    name = criterion_name(study)
    values = (f"{name} [–]", *(() if _value_is_eigenvalue(study) else ("λmin [–]",)), "second [–]")
    cap, sensors = ("below its cap [%]",) if _has_cap(study) else (), ("sensors",) if len(study.suites) > 1 else ()
    states = tuple(signal_label(signal) for signal in facts.states_of(study))
    durations = ("duration [s]",) if _durations_differ(study) else ()
    rows = tuple(_path_row(study, candidate, quality) for candidate in study.candidates for quality in candidate.qualities)
    return Table(
        "Paths",
        f"Good: large {name}, small standard deviations. Eigenvalues are of S W S, S the prior's standard deviations: λmin has no unit. "
        "Standard deviations are the Cramér-Rao bound on the start state from all measurements, without prior and process noise; "
        "hidden: no bound at all.",
        ("path", *sensors, *durations, *values, *states, *(("meets the limits",) if _has_limits(study) else ()), *cap),
        rows,
    )


def contributions_table(study: Study) -> Table:
    """Which sensor says how much about each state along the designed path, and where most of it comes from."""
    contributions = study.main.contributions
    rows = [
        (
            Cell(signal_label(signal)),
            _deviation(contributions.std[i], signal),
            *(_percentage(share) for share in contributions.shares[i].sum(axis=0)),
            Cell(_bulk_text(study, contributions.shares[i])),
        )
        for i, signal in enumerate(facts.states_of(study))
    ]
    weakest = (Cell("weakest combination"), Cell(DASH), *map(_percentage, contributions.weakest_shares.sum(axis=0)))
    return Table(
        f"Who says what on {path_in_words(study.about)}, all sensors on",
        "Good: small standard deviations that do not hang on one sensor. Known to: the Cramér-Rao bound on the start state; the shares of "
        "the sensors in what is known add up to 100; most of it: the shortest stretch that holds 70 % of the largest share.",
        ("state", "known to", *(f"{name} [%]" for name in contributions.sensors), "most of it"),
        (*rows, (*weakest, Cell(_bulk_text(study, contributions.weakest_shares)))),
    )


def _percentage(share: float) -> Cell:
    return Cell(DASH if np.isnan(share) else plain(round(100 * share)))


def _bulk_text(study: Study, shares: np.ndarray) -> str:
    if np.isnan(shares).any():
        return "nothing says anything"
    sensor, first, last = shortest_bulk(shares)
    times = facts.segment_nodes(study)
    share, name = shares[first : last + 1, sensor].sum(), study.scenario.sensor_names[sensor]
    return f"{plain(round(100 * share))}{NARROW}% by {name} at {plain(times[first])}–{plain(times[last + 1])}{NARROW}s"


def starts_table(study: Study, suite: int) -> Table:
    """What each start of the solver came to for one suite."""
    design, words = study.designs[suite], facts.sensors_in_words(study, study.suites[suite])
    name, best = objective_name(study), design.objective - 1e-6 * abs(design.objective)
    rows = tuple(
        (
            Cell(start.name),
            Cell(numeral(start.value), "good" if start.refined and start.value >= best else ""),
            Cell(plain(start.iterations)),
            Cell(start.status.value if start.refined else f"{start.status.value}, coarse", "" if start.status.has_answer else "bad"),
        )
        for start in design.starts
    )
    return Table(
        f"Starts of the solver, designed for {words}",
        f"Good: large {name}, and several starts that agree on it. The best (green) is taken; each is a local optimum at best.",
        ("start", f"{name} [–]", "iterations [–]", "status"),
        rows,
    )


def checks_table(study: Study) -> Table:
    """Final errors, their bounds, and consistency for every path and schedule."""
    head = (
        "path",
        "schedule",
        *(signal_label(signal) for signal in facts.states_of(study)),
        "in the band [%]",
        "highest NEES [–]",
        "filter",
    )
    low, high = study.checks[0].validation.nees_interval
    runs = study.checks[0].validation.runs
    return Table(
        f"Filter errors at the end, {runs} runs each",
        "Good: a small error, close to its posterior Cramér-Rao bound (1σ, in brackets), and a consistent filter: run-averaged NEES in its "
        f"95{NARROW}% band, {numeral(low)} to {numeral(high)}, at {plain(100 * CONSISTENT_SHARE)}{NARROW}% or more of the instants after "
        f"{plain(facts.settling_time(study))}{NARROW}s.",
        head,
        tuple(_check_row(study, check) for check in study.checks),
    )


def _dimension(verdict: Verdict, hidden: tuple[str, ...]) -> Cell:
    n = len(verdict.null_space)
    text = f"{'' if verdict.decided else '≥' + NARROW}{verdict.dimension} of {n}"
    if verdict.observable:
        return Cell(text, "good")
    return Cell(f"{text} ({_letter(hidden.index(verdict.hidden))})", "bad")


def _letter(i: int) -> str:
    return chr(ord("a") + i) if i < 26 else f"{chr(ord('a') + i // 26 - 1)}{chr(ord('a') + i % 26)}"


def _component(value: float, signal: Signal) -> str:
    text = numeral(value) if abs(value) > 1e-12 else "0"
    return f"{text}{NARROW}{signal.unit}"


def _path_row(study: Study, candidate: Candidate, quality: Quality) -> tuple[Cell, ...]:
    values = facts.clean_eigenvalues(quality)
    shown = values[1:2] if _value_is_eigenvalue(study) else values[:2]
    violations = candidate.violations
    limits = Cell(f"no: {violations_in_words(violations)}", "bad") if violations else Cell("yes", "good")
    return (
        Cell(candidate.name),
        *((Cell(facts.sensors_in_words(study, quality.sensors)),) if len(study.suites) > 1 else ()),
        *((Cell(plain(candidate.duration)),) if _durations_differ(study) else ()),
        Cell(numeral(facts.value_of(study, quality)), "bad" if facts.value_of(study, quality) in (0.0, float("-inf")) else ""),
        *(Cell(numeral(value)) for value in shown),
        *(_deviation(value, signal) for value, signal in zip(quality.std, facts.states_of(study), strict=True)),
        *((limits,) if _has_limits(study) else ()),
        *([_cap_cell(study, candidate, quality)] if _has_cap(study) else []),
    )


def _value_is_eigenvalue(study: Study) -> bool:
    """Whether the value of a path is the first of the eigenvalues that its row shows."""
    return facts.judged_by_eigenvalue(study) and facts.is_about_all_states(study)


def _has_limits(study: Study) -> bool:
    return bool(study.designs or study.scenario.design.constraints) and bool(study.checks)


def _has_cap(study: Study) -> bool:
    return any(design.cap is not None for design in study.designs)


def _durations_differ(study: Study) -> bool:
    return len({candidate.duration for candidate in study.candidates}) > 1


def _deviation(value: float, signal: Signal) -> Cell:
    return Cell("hidden", "bad") if np.isinf(value) else Cell(numeral(value * display_unit(signal)[0]))


def _cap_cell(study: Study, candidate: Candidate, quality: Quality) -> Cell:
    cap, design = facts.cap_for(study, quality.sensors), study.designs[study.suites.index(quality.sensors)]
    if cap is None:
        return Cell("no cap")
    if candidate.duration != design.problem.longest:
        return Cell(DASH)
    short = 1 - facts.value_of(study, quality) / cap.value
    return Cell("cap reached", "good") if short <= 1e-6 else Cell(numeral(100 * short))


def _check_row(study: Study, check: FilterCheck) -> tuple[Cell, ...]:
    validation = check.validation
    pairs = zip(validation.rmse[-1], validation.bound[-1], facts.states_of(study), strict=True)
    errors = (f"{numeral(rmse * display_unit(signal)[0])} ({numeral(bound * display_unit(signal)[0])})" for rmse, bound, signal in pairs)
    return (
        Cell(check.path),
        Cell(check.schedule),
        *(Cell(text) for text in errors),
        Cell(numeral(100 * validation.in_band)),
        Cell(numeral(facts.nees_peak(check)[0])),
        Cell(validation.verdict, "good" if validation.consistent else "bad"),
    )
