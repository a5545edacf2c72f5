"""The schema of result.json."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from obsdesign.report.expectations import Expectation

SCHEMA_VERSION = "1.5"


def _null_if_infinite(value: Any) -> Any:  # noqa: ANN401
    return None if isinstance(value, float) and not math.isfinite(value) else value


# JSON has no NaN and no infinity: both are null, and each field says what null means
Number = Annotated[float | None, BeforeValidator(_null_if_infinite)]


class _DocumentPart(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ScenarioPart(_DocumentPart):
    """Which scenario this is the result of."""

    title: str
    file: str = Field(description="name of the file")
    sha256: str = Field(description="of the file's bytes")
    states: list[str]
    state_units: list[str]
    sensors: list[str]


class VerdictPart(_DocumentPart):
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


class QualityPart(_DocumentPart):
    """How well a suite of sensors sees the start state along a path, without a prior."""

    value: Number = Field(description="criterion of S W S, S = prior standard deviations; null: minus infinity")
    eigenvalues: list[float] = Field(description="of S W S, ascending, no unit")
    std: list[Number] = Field(description="Cramer-Rao standard deviation per state in its unit; null: hidden")


class ContributionPart(_DocumentPart):
    """Who says what is known of one component of the start state."""

    std: Number = Field(description="Cramer-Rao standard deviation in the state's unit; null: hidden")
    by_sensor: dict[str, Number] = Field(description="share of each sensor, adding up to 1; null: hidden")
    in_words: str


class ViolationPart(_DocumentPart):
    """A limit that a path breaks."""

    what: str
    time: float = Field(description="when it is broken most [s]")
    by: float = Field(description="in `unit`")
    unit: str


class PathPart(_DocumentPart):
    """A path and its quality for each suite of sensors."""

    feasible: bool = Field(description="whether it satisfies every limit of the design")
    shortfalls: list[ViolationPart] = Field(description="the limits that it breaks, worst first")
    duration: float = Field(description="[s]")
    quality: dict[str, QualityPart]
    contributions: dict[str, ContributionPart] = Field(description="by state; all sensors on")


class StartPart(_DocumentPart):
    """One start of the solver."""

    name: str
    status: str
    value: Number = Field(description="the objective, recomputed; null: no answer")
    iterations: int
    residual: Number = Field(description="projected gradient of the Lagrangian, in units of the objective")
    refined: bool = Field(description="false: left in a coarser family, as another start was better there")


class CapPart(_DocumentPart):
    """An upper bound on the value of every path."""

    value: float
    states: list[str] = Field(description="the block of S W S that no path changes")
    reached: bool


class OptimumPart(_DocumentPart):
    """A local optimum and the starts that came to it."""

    value: float = Field(description="the objective")
    starts: list[str]


class RobustnessPart(_DocumentPart):
    """The criterion over fresh draws of the prior, the same inputs for all."""

    draws: int
    worst: float
    five_percent: float = Field(description="95 % of the draws are above it")
    mean: float


class EvidencePart(_DocumentPart):
    """How much better another path might be: evidence, not proof."""

    estimate: Number = Field(description="no path above it was met in `climbs` climbs along the dual question")
    remaining: Number = Field(description="1 - value / estimate")
    dual: list[list[float]] = Field(description="Z >= 0, trace 1 over the judged states, of the estimate")
    climbs: int
    in_words: str


class DesignPart(_DocumentPart):
    """The path designed for a suite of sensors."""

    status: str
    value: Number = Field(description="criterion of S W S, recomputed; null: no answer")
    objective: Number = Field(description="what was maximised: the value, of the prior's draws if robust, less prices")
    eigenvalues: list[Number] = Field(description="the two smallest of S W S")
    duration: float = Field(description="[s]")
    residual: Number = Field(description="projected gradient of the Lagrangian, in units of the objective")
    iterations: int
    cap: CapPart | None
    optima: list[OptimumPart] = Field(description="distinct ones among the refined starts, best first")
    robustness: RobustnessPart | None
    evidence: EvidencePart | None
    starts: list[StartPart]


class LossPart(_DocumentPart):
    """A sensor is lost."""

    kept: Number = Field(description="value of the schedule without it; null: too little is seen for the criterion")
    rechosen: Number = Field(description="value of a schedule of the others; null as above")
    bound: Number = Field(description="no schedule of the others is better than this")


class ParetoPart(_DocumentPart):
    """Information against what the energy budget counts: for each limit the best schedule found."""

    limits: list[float]
    spent: list[float]
    values: list[Number]
    bounds: list[Number] = Field(description="no schedule within the limit is better than this")
    chosen: list[list[list[int]]] = Field(description="the schedules, (K, S) each")


class SelectionPart(_DocumentPart):
    """The sensor schedule along a path."""

    criterion: str = Field(description="kind of the criterion of S W S, from which what switching costs is taken off")
    criterion_label: str = Field(description="what sentences call it")
    gap_kind: Literal["relative", "absolute"] = Field(description="whether the gap is a share of the bound or a difference")
    per_segment: int
    robust_to: int = Field(description="how many sensors may be lost: the value is that of the worst loss")
    rules: list[str]
    status: str
    chosen: list[list[int]] = Field(description="(K, S): 1 where the sensor is on in the segment")
    seconds: dict[str, float] = Field(description="how long each sensor is on [s]")
    value: Number = Field(description="the criterion of the schedule")
    exact_value: Number | None = Field(
        description="that of all its samples together, where errors are not independent and value and bound count amounts from below; "
        "null: value is exact"
    )
    bound: Number = Field(description="no schedule that keeps the rules is better than this")
    root_bound: Number
    gap: Number = Field(description="(bound - value) / |bound|, or bound - value where gap_kind is absolute")
    fractional_segments: int
    nodes: int = Field(description="partial schedules that the proof looked at")
    notes: list[str] = Field(description="what went otherwise than planned")
    dual: list[Any] = Field(description="with offset and prices what proves root_bound: Z, (n, n), or one for each set of lost sensors")
    offset: Number
    prices: list[Number] = Field(description="what one more unit of each budget is worth")
    forced_on: list[list[Number]] = Field(description="(K, S): how much root_bound falls when the sensor is forced on; null: impossible")
    forced_off: list[list[Number]] = Field(description="(K, S): when it is forced off")
    naive: dict[str, Number] = Field(description="values of naive schedules")
    broken: dict[str, list[str]] = Field(description="the rules that naive schedules break")
    random_best: Number = Field(description="of random schedules that keep the rules; null: none was found")
    random_median: Number
    random_count: int
    losses: dict[str, LossPart] = Field(description="by lost sensor")
    pareto: ParetoPart | None = Field(description="null: none was asked for")


class PairPart(_DocumentPart):
    """A path and a schedule for each other."""

    value: Number = Field(description="criterion of what the schedule sees along the path, less what switching costs; null: no answer")
    chosen: list[list[int]]
    trajectory: dict[str, list[float]] = Field(description="by state, and t; empty: no answer")


class JointPart(_DocumentPart):
    """Path and schedule chosen together, and one after the other."""

    status: str
    joint: PairPart
    path_first: PairPart = Field(description="the path for all sensors, then the best schedule for it")
    sensors_first: PairPart = Field(description="the best schedule for a path taken without thinking, then the path for it")
    alternation: list[float] = Field(description="objective after every half step on the way to the answer")
    bound: Number = Field(description="no schedule for the joint path is better than this")
    gap: Number


class ValidationPart(_DocumentPart):
    """Filter runs on one path with one schedule."""

    verdict: str = Field(description="consistent, overconfident or underconfident")
    in_band: float = Field(description="share of the instants after the first quarter with run-averaged NEES in its 95 % band")
    nees_interval: tuple[float, float]
    nees: list[float] = Field(description="run-averaged, at every t")
    final_rmse: dict[str, float] = Field(description="root mean square error of each state at the end, in its unit")
    final_bound: dict[str, Number] = Field(description="posterior Cramer-Rao standard deviation there; null: hidden")
    rmse: dict[str, list[float]]
    bound: dict[str, list[Number]]
    runs: int


class PlanPart(_DocumentPart):
    """A plan made on a flight."""

    status: str
    feasible: bool = Field(description="whether it keeps every limit from where the filter believes to be")
    age: int = Field(description="how many plans ago its inputs were found")
    value: Number = Field(description="objective of the plan, what the filter knows included; null: not computed")


class FlightHistoryPart(_DocumentPart):
    """A flight with the filter in the loop; histories by state or input."""

    truth: dict[str, list[float]]
    mean: dict[str, list[float]] = Field(description="the filter's estimate")
    std: dict[str, list[float]] = Field(description="the filter's standard deviation")
    u: dict[str, list[float]] = Field(description="inputs, one fewer than t")
    nees: list[float]
    final_error: dict[str, float] = Field(description="|estimate - truth| at the end")
    final_std: dict[str, float]
    shortfalls: list[ViolationPart] = Field(description="limits that the true states broke, worst first")
    margin: Number = Field(description="least margin of the limits along the true states, 1 = a tolerance or radius; null: no limits")


class FlightPart(_DocumentPart):
    """A flight that was planned anew on the way, and the same with all inputs in the middle of their ranges."""

    t: list[float]
    flown: FlightHistoryPart
    middle: FlightHistoryPart | None
    plans: list[PlanPart]
    feasible_plans: int


class Result(_DocumentPart):
    """Everything a study found. The same scenario, seed and versions give the same bytes save for `timings`."""

    schema_version: str
    scenario: ScenarioPart
    seed: int
    versions: dict[str, str]
    analyses: dict[str, dict[str, VerdictPart]] = Field(description="by manoeuvre, then by sensors joined with +")
    designs: dict[str, DesignPart] = Field(description="by suite; all = all sensors; nothing where paths are given")
    paths: dict[str, PathPart]
    selection: SelectionPart = Field(description="of the designed path, or of the first that is given")
    selections: dict[str, SelectionPart] = Field(description="by path, where several are given")
    t: list[float] = Field(description="times of the histories below [s]")
    validation: dict[str, dict[str, ValidationPart]] = Field(description="by path, then by schedule")
    joint: JointPart | None = Field(description="null: none was asked for")
    flight: FlightPart | None = Field(description="null: none was asked for")
    expected: list[Expectation]
    timings: dict[str, float] = Field(description="seconds per stage; the only part that varies from run to run")
