"""Parts of result.json: the scenario, what is observable, paths and their designs."""

from __future__ import annotations

import json
import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _null_if_infinite(value: Any) -> Any:  # noqa: ANN401
    return None if isinstance(value, float) and not math.isfinite(value) else value


# JSON has no NaN and no infinity: both are null, and each field says what null means
Number = Annotated[float | None, BeforeValidator(_null_if_infinite)]


class DocumentPart(BaseModel):
    """What all parts share: frozen, and nothing in them that the schema does not name."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def as_json(document: DocumentPart) -> str:
    """Return a document as text: numbers at full precision, the same order every time."""
    return json.dumps(document.model_dump(mode="json"), indent=1, allow_nan=False) + "\n"


class ScenarioPart(DocumentPart):
    """Which scenario this is the result of."""

    title: str
    file: str = Field(description="name of the file")
    sha256: str = Field(description="of the file's bytes")
    source: str = Field(description="text of the file; empty: the scenario was made in Python")
    states: list[str]
    state_units: list[str]
    sensors: list[str]


class VerdictPart(DocumentPart):
    """What a suite of sensors sees in a manoeuvre, at the start state."""

    dimension: int = Field(description="of the observable space")
    states: int = Field(description="n")
    observable: bool
    decided: bool = Field(description="false: the precision limit was reached and nothing is claimed")
    ranks: list[int] = Field(description="after each sweep of Lie derivatives")
    observable_states: list[str]
    unobservable_states: list[str]
    hidden: str = Field(description="the hidden directions in words")
    null_space: list[list[float]] = Field(description="orthonormal hidden directions, each a list over the states")
    proof: str


class QualityPart(DocumentPart):
    """How well a suite of sensors sees the start state along a path, without a prior."""

    value: Number = Field(description="criterion of S W S, S = prior standard deviations; null: minus infinity")
    eigenvalues: list[float] = Field(description="of S W S, ascending, no unit")
    std: list[Number] = Field(description="Cramer-Rao standard deviation per state in its unit; null: hidden")


class ContributionPart(DocumentPart):
    """Who says what is known of one component of the start state."""

    std: Number = Field(description="Cramer-Rao standard deviation in the state's unit; null: hidden")
    by_sensor: dict[str, Number] = Field(description="share of each sensor, adding up to 1; null: hidden")
    in_words: str


class ViolationPart(DocumentPart):
    """A limit that a path breaks."""

    what: str
    time: float = Field(description="when it is broken most [s]")
    by: float = Field(description="in `unit`")
    unit: str


class PathPart(DocumentPart):
    """A path and its quality for each suite of sensors."""

    feasible: bool = Field(description="whether it satisfies every limit of the design")
    shortfalls: list[ViolationPart] = Field(description="the limits that it breaks, worst first")
    duration: float = Field(description="[s]")
    quality: dict[str, QualityPart]
    contributions: dict[str, ContributionPart] = Field(description="by state; all sensors on")


class StartPart(DocumentPart):
    """One start of the solver."""

    name: str
    status: str
    value: Number = Field(description="the objective, recomputed; null: no answer")
    iterations: int
    residual: Number = Field(description="projected gradient of the Lagrangian, in units of the objective")
    refined: bool = Field(description="false: left in a coarser family, as another start was better there")


class CapPart(DocumentPart):
    """An upper bound on the value of every path."""

    value: float
    states: list[str] = Field(description="the block of S W S that no path changes")
    reached: bool


class OptimumPart(DocumentPart):
    """A local optimum and the starts that came to it."""

    value: float = Field(description="the objective")
    starts: list[str]


class RobustnessPart(DocumentPart):
    """The criterion over fresh draws of the prior, the same inputs for all."""

    draws: int
    worst: float
    five_percent: float = Field(description="95 % of the draws are above it")
    mean: float


class EvidencePart(DocumentPart):
    """How much better another path might be: evidence, not proof."""

    estimate: Number = Field(description="no path above it was met in `climbs` climbs along the dual question")
    remaining: Number = Field(description="1 - value / estimate")
    dual: list[list[float]] = Field(description="Z >= 0, trace 1 over the judged states, of the estimate")
    climbs: int
    in_words: str


class PathCertificatePart(DocumentPart):
    """What `check_path_bound` proves the bound from; no multipliers: the bound is the cap."""

    level: float = Field(description="where the quadratic form of every path ends")
    share: float = Field(description="of it that Young's inequality takes for what pieces leave out")
    lengths: list[int] = Field(description="steps of each piece of the Gram matrix")
    multipliers: list[float] = Field(description="of the constraints on that matrix")


class PathBoundPart(DocumentPart):
    """What proves that no path of a class is better."""

    class_of_paths: str
    left_out: list[str] = Field(description="what the bound makes no use of")
    reason: str = Field(description="why there is no bound, or none but the cap; empty where the relaxation gave it")
    certificate: PathCertificatePart | None


class JointCertificatePart(DocumentPart):
    """A tree of cases of schedules, and what proves a bound at each of its ends."""

    branches: list[tuple[int, int]] = Field(
        description="[segment, option] of a node, what follows where that is taken, then where it is not; [-1, -1] at an end"
    )
    ends: list[PathCertificatePart]


class JointBoundPart(DocumentPart):
    """What proves that no path with any schedule is better."""

    bound: Number = Field(description="no path has a value above it with any schedule; null: none is proven")
    gap: Number
    class_of_paths: str
    left_out: list[str] = Field(description="what the bound makes no use of")
    reason: str = Field(description="why there is no bound; empty where there is one")
    certificate: JointCertificatePart | None


class GapSearchPart(DocumentPart):
    """A search that went on until its gap was small enough, or its limit of starts was reached."""

    gap: float = Field(description="that was asked for")
    limit: int = Field(description="how many starts were allowed")
    in_words: str = Field(description="how it ended")


class DesignPart(DocumentPart):
    """The path designed for a suite of sensors."""

    status: str
    value: Number = Field(description="criterion of S W S, recomputed; null: no answer")
    objective: Number = Field(description="what was maximised: the value, of the prior's draws if robust, less prices")
    eigenvalues: list[Number] = Field(description="the two smallest of S W S")
    duration: float = Field(description="[s]")
    residual: Number = Field(description="projected gradient of the Lagrangian, in units of the objective")
    iterations: int
    cap: CapPart | None
    bound: Number = Field(description="no path has a value above it; null: none is proven")
    gap: Number = Field(description="1 - value / bound; value / bound - 1 where that is negative; null: no bound")
    proof: PathBoundPart
    optima: list[OptimumPart] = Field(description="distinct ones among the refined starts, best first")
    robustness: RobustnessPart | None
    evidence: EvidencePart | None
    search: GapSearchPart | None = Field(description="null: no gap was asked for")
    starts: list[StartPart]


class WayPointsPart(DocumentPart):
    """What it costs to fly through few points of the path as an autopilot does; pairs: of the path itself, of the flight."""

    points: int = Field(description="how many way points")
    of: int = Field(description="nodes of the path")
    tolerance: float | None = Field(description="how near the path stays to its way points [m]; null: they were taken by time")
    every: float | None = Field(description="one way point every so many seconds [s]; null: they were taken by tolerance")
    autopilot: Literal["px4", "ardupilot"] = Field(description="whose guidance flew")
    deviation: float = Field(description="farthest that the flight is from the path [m]")
    duration: tuple[float, float] = Field(description="[s]")
    reached: bool = Field(description="whether the last way point was reached")
    lambda_min: tuple[Number, Number] = Field(description="of S W S, all sensors on")
    std: dict[str, tuple[Number, Number]] = Field(
        description="standard deviations of the filter at the end with the schedule, by state, in its unit"
    )
    broken: list[str] = Field(description="limits that the flight breaks and the path keeps")
