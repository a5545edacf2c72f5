"""What stays hidden from all sensors together, and why?"""

from __future__ import annotations

from collections.abc import Iterator

from obsdesign.analysis.verdict import Verdict
from obsdesign.report.number_format import NOTHING, join, numeral, typeset
from obsdesign.report.section import Section
from obsdesign.report.sections.observability import hidden_table
from obsdesign.report.table import Table, TableColumn, tabulate
from obsdesign.study.analysis_study import AnalysisStudy, case_name, cases_apart, suite_name
from obsdesign.study.record import Analysis

_SHOWN = 5  # remedies of a case


def section(study: AnalysisStudy) -> Section | None:
    """Return what the largest suites miss, case by case; None where they miss nothing."""
    largest = {analysis.sensors for analysis in study.of_all_sensors}
    missing = [analysis for analysis in cases_apart(study) if analysis.sensors in largest and not analysis.verdict.observable]
    if not missing:
        return None
    hidden = (hidden_table(study.scenario.states, suite_name(study, analysis.sensors), analysis) for analysis in missing)
    tables, notes = [*_remedies_tables(study), *hidden], [_sentence(study, analysis) for analysis in missing]
    if study.scenario.analysis.known_at_start:
        notes.append("Why, and what would mend it, is not looked for where states are known at the start.")
    return Section("hidden", "What stays hidden, and why?", "", (), tuple(tables), tuple(dict.fromkeys(notes)))


def _remedies_tables(study: AnalysisStudy) -> Iterator[Table]:
    """What would mend each case, the cheapest first."""
    if not study.hidden:
        return
    rows = []
    for case in study.hidden:
        tried, cheapest = case.remedies, case.remedies.cheapest[:_SHOWN]
        nothing = f"nothing of {join(tried.offered, 'or') or 'what there is'}, up to {tried.at_once} at once"
        rows.append(
            (_case(study, case.analysis, case_name(study, case.analysis)), join([remedy.in_words for remedy in cheapest], "or") or nothing)
        )
    good = "Each of them was tried: with it every state is seen."
    yield tabulate("What would mend it", good, (TableColumn("case"), TableColumn("mended by")), rows)


def _sentence(study: AnalysisStudy, analysis: Analysis) -> str:
    """Say what a case hides, and why; analysis: of a case that bears its name."""
    verdict = analysis.verdict
    whose = next((case for case in study.hidden if case.analysis.verdict is verdict), None)
    because = "" if whose is None or not whose.reasons else f" Because {join([reason.in_words for reason in whose.reasons])}."
    return typeset(f"{_case(study, analysis, analysis.manoeuvre)}: {verdict.hidden}.{because}")


def _case(study: AnalysisStudy, analysis: Analysis, name: str) -> str:
    """Return what a case is called that bears a name, with its suite where there are several largest ones."""
    suites = {whole.sensors for whole in study.of_all_sensors}
    return name if len(suites) == 1 else f"{' + '.join(analysis.sensors)}, {name}"


def growth_section(study: AnalysisStudy) -> Section:
    """Return how the dimension grew with the derivatives, and what was proven."""
    return Section("proof", "How is that known?", _point_text(study), (), (_growth_table(study),), tuple(dict.fromkeys(_proofs(study))))


def _growth_table(study: AnalysisStudy) -> Table:
    """Ranks after 0, 1, 2, ... steps for every case."""
    cases = cases_apart(study)
    steps = max(len(analysis.verdict.ranks) for analysis in cases)
    heads = (TableColumn("sensors"), TableColumn("case"), *(TableColumn(str(k)) for k in range(steps)), TableColumn("ended by"))
    rows = (
        (" + ".join(analysis.sensors), analysis.manoeuvre, *_ranks(analysis.verdict, steps), _STOPS[analysis.verdict.stopped_by])
        for analysis in cases
    )
    good = "Columns count derivatives: how many combinations of states are known from outputs and their derivatives up to that order."
    return tabulate("Dimension, derivative by derivative", good, heads, rows)


def _ranks(verdict: Verdict, steps: int) -> Iterator[str]:
    yield from (str(rank) for rank in verdict.ranks)
    yield from [NOTHING] * (steps - len(verdict.ranks))


_STOPS = {
    "full": "all is seen",
    "criterion": "one more derivative adds nothing",
    "cap": "as much as if all inputs were known",
    "bound": "as many derivatives as can matter",
    "stalled": "no growth for long: a lower bound",
    "precision": "digits: a lower bound",
}


def _point_text(study: AnalysisStudy) -> str:
    """Say which point the verdicts are about."""
    if study.at is None:
        return "The verdicts hold at almost every state."
    values = ", ".join(f"{name} = {numeral(float(value), 6)}" for name, value in zip(study.scenario.state_names, study.at, strict=True))
    return f"The verdicts hold at {values}."


def _proofs(study: AnalysisStudy) -> Iterator[str]:
    for analysis in cases_apart(study):
        if analysis.sensors in {whole.sensors for whole in study.of_all_sensors}:
            yield f"{' + '.join(analysis.sensors)}, {analysis.manoeuvre}: {typeset(analysis.verdict.proof)}."
