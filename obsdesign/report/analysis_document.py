"""The JSON of the verdicts of a scenario."""

from __future__ import annotations

from pydantic import Field

from obsdesign.report.document import Result
from obsdesign.report.document_parts import DocumentPart, ScenarioPart, VerdictPart
from obsdesign.report.expectations import Expectation, check_expectations
from obsdesign.report.question_to_document import scenario_part, verdict_part, versions
from obsdesign.study.analysis_along import AlongPath
from obsdesign.study.analysis_study import AnalysisStudy, HiddenCase


class StretchPart(DocumentPart):
    """A stretch of a path on which outputs and their derivatives do not tell the state."""

    start: float = Field(description="[s]")
    end: float = Field(description="[s]")
    rank: int = Field(description="how many directions are seen")
    null_space: list[list[float]] = Field(description="orthonormal hidden directions, each a list over the states")


class AlongPart(DocumentPart):
    """How near the motion along a path comes to hiding the state."""

    name: str = Field(description="of the file")
    orders: int = Field(description="up to which order derivatives were taken")
    t: list[float] = Field(description="[s]")
    nearness: list[float] = Field(description="smallest singular value over the largest, at each instant; 0: something is hidden")
    rank: list[int] = Field(description="how many directions are seen, at each instant")
    hidden: list[StretchPart] = Field(description="in the order of time")
    notes: list[str] = Field(description="what was made of the file")


class HiddenPart(DocumentPart):
    """A case in which all sensors together, or a largest suite that was asked about, do not see the state."""

    sensors: list[str] = Field(description="the suite")
    manoeuvre: str = Field(description="how it moves")
    disturbance: str = Field(description="what unknown inputs may be")
    reasons: list[str] = Field(description="why, each a theorem whose hypotheses hold")
    remedies: list[str] = Field(description="in words, the cheapest first; none: nothing that was tried mends it")
    tried: list[str] = Field(description="sensors that were added, and held inputs that were let vary")


class AnalysisDocument(DocumentPart):
    """What every suite of sensors sees, under every class of disturbances, in every manoeuvre."""

    scenario: ScenarioPart
    seed: int = Field(description="of the random states that stand for almost every one")
    versions: dict[str, str] = Field(description="those that may change a number")
    at: dict[str, float] | None = Field(description="the state that is asked about; null: almost every one")
    verdicts: dict[str, dict[str, dict[str, VerdictPart]]] = Field(description="by manoeuvre, by disturbance, by sensors joined with +")
    hidden: list[HiddenPart] = Field(description="cases in which the largest suites do not see the state: why, and what would mend it")
    along: AlongPart | None = Field(default=None, description="null: no path was given")
    expected: list[Expectation] = Field(description="known truths of the scenario, but for those of a run")


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
        hidden=list(map(_hidden_part, study.hidden)),
        along=None if study.along is None else _along_part(study.along),
        expected=[],
    )
    asked = [entry for entry in scenario.expected if entry.key.partition(".")[0] not in _OF_A_RUN]
    return draft.model_copy(update={"expected": check_expectations(asked, draft.model_dump())})


_OF_A_RUN = set(Result.model_fields) - set(AnalysisDocument.model_fields)  # keys of known truths that `run` looks at


def _hidden_part(case: HiddenCase) -> HiddenPart:
    return HiddenPart(
        sensors=list(case.analysis.sensors),
        manoeuvre=case.analysis.manoeuvre,
        disturbance=case.analysis.verdict.disturbance,
        reasons=[reason.in_words for reason in case.reasons],
        remedies=[remedy.in_words for remedy in case.remedies.cheapest],
        tried=list(case.remedies.offered),
    )


def _along_part(along: AlongPath) -> AlongPart:
    motion = along.motion
    stretches = [StretchPart(start=i.start, end=i.end, rank=i.rank, null_space=i.null_space.T.tolist()) for i in motion.hidden]
    return AlongPart(
        name=along.name,
        orders=motion.orders,
        t=motion.t.tolist(),
        nearness=motion.nearness.tolist(),
        rank=motion.rank.tolist(),
        hidden=stretches,
        notes=list(along.notes),
    )
