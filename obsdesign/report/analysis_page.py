"""The verdicts of a scenario as one self-contained HTML page."""

from __future__ import annotations

from obsdesign.report.analysis_sections import along, hidden, sees
from obsdesign.report.page import environment
from obsdesign.report.question_to_document import versions
from obsdesign.report.section import KeyNumber
from obsdesign.study.analysis_study import AnalysisStudy, case_name


def analysis_page(study: AnalysisStudy) -> str:
    """Return the page: HTML without any reference to the network; the same study gives the same text."""
    motion = None if study.along is None else along.section(study.along)
    parts = tuple(filter(None, (sees.section(study), hidden.section(study), motion, hidden.growth_section(study))))
    scenario = study.scenario
    return (
        environment()
        .get_template("analysis.html.j2")
        .render(
            title=scenario.title,
            question=scenario.question,
            answer=sees.answer(study),
            headline=_headline(study),
            parts=parts,
            system=str(scenario.system),
            versions=versions(),
        )
    )


def _headline(study: AnalysisStudy) -> tuple[KeyNumber, ...]:
    """Return what all sensors together see in each case, the first few."""
    shown = study.of_all_sensors[:6]
    counts = (f"{analysis.verdict.dimension} of {len(analysis.verdict.null_space)}" for analysis in shown)
    return tuple(KeyNumber("sees", count, case_name(study, analysis)) for count, analysis in zip(counts, shown, strict=True))
