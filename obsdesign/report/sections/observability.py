"""Can it? What each combination of sensors sees in each manoeuvre."""

from __future__ import annotations

from collections.abc import Sequence

from obsdesign.analysis.verdict import Verdict
from obsdesign.report import derived_quantities as facts
from obsdesign.report.number_format import NARROW, join, numeral, typeset
from obsdesign.report.section import Section
from obsdesign.report.table import Table, TableColumn, Toned, tabulate
from obsdesign.signals import Signal
from obsdesign.study.record import Analysis, Study

_FEW = 2  # manoeuvres that are told one by one


def section(study: Study) -> Section:
    """Return the answer to "Can it?"."""
    hidden = tuple(
        hidden_table(facts.states_of(study), facts.sensors_in_words(study, suite), analysis)
        for suite in study.suites
        for analysis in facts.unobservable_analyses(study, suite)
    )
    return Section("can", "Can it?", answer(study), (), (subsets_table(study.analyses), *hidden), (_proof_note(study),))


def answer(study: Study) -> str:
    """Say who sees everything, in which manoeuvre, and what the reported suites miss."""
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


def _proof_note(study: Study) -> str:
    """Say how the dimensions were decided, and of one verdict what its proof is."""
    shown = (*(analysis for suite in study.suites for analysis in facts.unobservable_analyses(study, suite)), *study.analyses)[0]
    who = f"{facts.sensors_in_words(study, shown.sensors)}, {shown.manoeuvre}"
    return f"{decision_note(study.analyses)} For {who}: {typeset(shown.verdict.proof)}."


def decision_note(analyses: Sequence[Analysis]) -> str:
    """Say how the dimensions were decided."""
    undecided = [analysis for analysis in analyses if not analysis.verdict.decided]
    how = "Dimensions are decided in ball arithmetic, which encloses every rounding error, not read off floating-point singular values."
    total = len(analyses)
    count = f"{len(undecided)} of {total} are undecided (marked ≥)" if undecided else f"All {total} are decided"
    return f"{how} {count}."


def subsets_table(analyses: Sequence[Analysis]) -> Table:
    """Dimension of the observable space for every subset of the sensors and every manoeuvre, hidden directions as notes."""
    verdicts = {(analysis.sensors, analysis.manoeuvre): analysis.verdict for analysis in analyses}
    subsets, manoeuvres = dict.fromkeys(key[0] for key in verdicts), dict.fromkeys(key[1] for key in verdicts)
    hidden = tuple(dict.fromkeys(verdict.hidden for verdict in verdicts.values() if not verdict.observable))
    n, letters = len(analyses[0].verdict.null_space), " Letters name what stays hidden." if hidden else ""
    return tabulate(
        "Dimension of the observable space",
        f"Good is {n} of {n}: every state can be found from the measurements.{letters}",
        (TableColumn("sensors"), *(TableColumn(f"{name} [dimensions]") for name in manoeuvres)),
        ((" + ".join(subset), *(_dimension(verdicts[subset, manoeuvre], hidden) for manoeuvre in manoeuvres)) for subset in subsets),
        tuple(f"{_letter(i)}{NARROW}: {typeset(text)}." for i, text in enumerate(hidden)),
    )


def hidden_table(states: Sequence[Signal], who: str, analysis: Analysis) -> Table:
    """The hidden directions of one suite in one manoeuvre as vectors; who: what the suite is called."""
    space = analysis.verdict.null_space
    columns = range(space.shape[1])
    return tabulate(
        f"What {who} cannot see, {analysis.manoeuvre}",
        "Good would be no direction at all. Moving the start state by any multiple of a column changes no measurement (to first order).",
        (TableColumn("state"), *(TableColumn(f"direction {k + 1}") for k in columns)),
        ((signal.name, *(_component(space[i, k], signal) for k in columns)) for i, signal in enumerate(states)),
    )


def _dimension(verdict: Verdict, hidden: tuple[str, ...]) -> Toned:
    n = len(verdict.null_space)
    text = f"{'' if verdict.decided else '≥' + NARROW}{verdict.dimension} of {n}"
    return Toned(text, "good") if verdict.observable else Toned(f"{text} ({_letter(hidden.index(verdict.hidden))})", "bad")


def _letter(i: int) -> str:
    return chr(ord("a") + i) if i < 26 else f"{chr(ord('a') + i // 26 - 1)}{chr(ord('a') + i % 26)}"


def _component(value: float, signal: Signal) -> str:
    text = numeral(value) if abs(value) > 1e-12 else "0"
    return f"{text}{NARROW}{signal.unit}"
