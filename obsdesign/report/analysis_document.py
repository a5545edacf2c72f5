"""The JSON of the verdicts of a scenario."""

from __future__ import annotations

from pydantic import Field

from obsdesign.report.document_parts import DocumentPart, ScenarioPart, VerdictPart
from obsdesign.report.expectations import Expectation, check_expectations
from obsdesign.report.question_to_document import scenario_part, verdict_part, versions
from obsdesign.study.analysis_study import AnalysisStudy


class AnalysisDocument(DocumentPart):
    """What every suite of sensors sees, under every class of disturbances, in every manoeuvre."""

    scenario: ScenarioPart
    seed: int
    versions: dict[str, str]
    at: dict[str, float] | None = Field(description="the state that is asked about; null: almost every one")
    verdicts: dict[str, dict[str, dict[str, VerdictPart]]] = Field(description="by manoeuvre, by disturbance, by sensors joined with +")
    expected: list[Expectation]


def analysis_document(study: AnalysisStudy) -> AnalysisDocument:
    """Return the document of a scenario's verdicts, expectations checked."""
    scenario = study.scenario
    verdicts: dict[str, dict[str, dict[str, VerdictPart]]] = {}
    for analysis in study.analyses:
        by_sensors = verdicts.setdefault(analysis.manoeuvre, {}).setdefault(analysis.verdict.disturbance, {})
        by_sensors["+".join(analysis.sensors)] = verdict_part(analysis.verdict)
    draft = AnalysisDocument(
        scenario=scenario_part(scenario),
        seed=study.seed,
        versions=versions(),
        at=None if study.at is None else dict(zip(scenario.state_names, study.at.tolist(), strict=True)),
        verdicts=verdicts,
        expected=[],
    )
    return draft.model_copy(update={"expected": check_expectations(scenario.expected, draft.model_dump())})
