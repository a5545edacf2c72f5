"""The schema of result.json."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from obsdesign.report.document_parts import (
    DesignPart,
    DocumentPart,
    JointBoundPart,
    Number,
    PathPart,
    ScenarioPart,
    VerdictPart,
    ViolationPart,
    WayPointsPart,
)
from obsdesign.report.expectations import Expectation

SCHEMA_VERSION = "1.8"


class LossPart(DocumentPart):
    """A sensor is lost."""

    kept: Number = Field(description="value of the schedule without it; null: too little is seen for the criterion")
    rechosen: Number = Field(description="value of a schedule of the others; null as above")
    bound: Number = Field(description="no schedule of the others is better than this")


class ParetoPart(DocumentPart):
    """Information against what the energy budget counts: for each limit the best schedule found."""

    limits: list[float]
    spent: list[float]
    values: list[Number]
    bounds: list[Number] = Field(description="no schedule within the limit is better than this")
    chosen: list[list[list[int]]] = Field(description="the schedules, (K, S) each")


class RatedPart(DocumentPart):
    """A schedule under both questions."""

    information: Number = Field(description="the criterion of what all samples say of the start: larger is better")
    cost: Number = Field(description="that of the filter's covariance along the way: smaller is better; null: a state is hidden")
    broken: list[str] = Field(description="the rules that it breaks")


class FilterPart(DocumentPart):
    """The schedule for what a filter knows along the way, in units of the prior's standard deviations."""

    criterion: str = Field(description="kind of the criterion of the covariance")
    minimised: str = Field(description="the cost, in words")
    over: str | list[float] = Field(description="which instants count: mean, worst, end, or a weight for each step")
    gap_kind: Literal["relative", "absolute"] = Field(description="whether the gap is a share of the value or a difference")
    status: str
    chosen: list[list[int]] = Field(description="(K, S): 1 where the sensor is on in the segment")
    seconds: dict[str, float] = Field(description="how long each sensor is on [s]")
    value: Number = Field(description="cost of the schedule: smaller is better")
    bound: Number = Field(description="no schedule that keeps the rules costs less than this")
    gap: Number = Field(description="1 - bound / value, or value - bound where gap_kind is absolute")
    bound_by: str = Field(description="what proved the bound")
    memory: Number = Field(description="segments until half of what a choice brings is forgotten; null: it never is")
    prices: list[list[Number]] = Field(description="(K, S): the cost without a sensor in a segment less that with it, all else as chosen")
    predicted: dict[str, list[Number]] = Field(description="standard deviations after the samples at t_k, k = 0..N-1, by state")
    compared: dict[str, Number] = Field(description="cost of what others would have on; some of them break rules")
    rated: dict[str, RatedPart] = Field(description="schedules under both questions")
    notes: list[str] = Field(description="what went otherwise than planned")


class RequirementPart(DocumentPart):
    """What a filter has to know along the way, and what it does know of it."""

    about: list[str] = Field(description="states: the standard deviation of one, the root of the summed variances of several")
    at_most: float = Field(description="the largest it may be, in `unit`")
    unit: str
    share: float = Field(description="at which share of the instants at least it holds")
    after: float = Field(description="only instants count that are later than so many seconds from the beginning [s]")
    instants: int = Field(description="how many count")
    may_fail: int = Field(description="at how many of them it may be above")
    failures: int | None = Field(description="at how many it is above with the cheapest schedule; null: there is none")
    size: Number = Field(description="largest with the cheapest schedule, but those at the instants that may fail; null: there is none")
    at: Number = Field(description="when that is [s]")


class CheapestPart(DocumentPart):
    """The cheapest schedule that keeps what is required of a filter."""

    status: str = Field(description="INFEASIBLE: proven that none keeps it, `notes` say why")
    chosen: list[list[int]] = Field(description="(K, S): 1 where the sensor is on in the segment")
    seconds: dict[str, float] = Field(description="how long each sensor is on [s]")
    cost: dict[str, float] = Field(description="what each sensor costs per segment that it is on")
    start: dict[str, float] = Field(description="what it costs to switch it on")
    value: Number = Field(description="what the schedule costs")
    bound: Number = Field(description="none that keeps what is required costs less")
    gap: Number = Field(description="1 - bound / value")
    bound_by: str = Field(description="what proved the bound")
    compared: dict[str, Number] = Field(description="what others cost; null: they break what is required")
    requirements: list[RequirementPart]
    notes: list[str] = Field(description="why there is none; what went otherwise than planned")


class SelectionPart(DocumentPart):
    """The sensor schedules along a path: value, bound and all that follows from them are about the start; `filter` is about the filter."""

    question: Literal["filter", "start", "cheapest"] = Field(description="which of them is asked")
    used: list[list[int]] = Field(
        description="(K, S): the schedule of the question that is asked, that of the filter where none keeps the requirements: "
        "`chosen` of validation, schedule.csv"
    )
    filter: FilterPart | None = Field(description="null: too many sets of sensors to choose from")
    cheapest: CheapestPart | None = Field(default=None, description="null: nothing is required")

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


class PairPart(DocumentPart):
    """A path and a schedule for each other."""

    value: Number = Field(description="criterion of what the schedule sees along the path, less what switching costs; null: no answer")
    chosen: list[list[int]]
    trajectory: dict[str, list[float]] = Field(description="by state, and t; empty: no answer")


class JointPart(DocumentPart):
    """Path and schedule chosen together, and one after the other."""

    question: Literal["filter", "start"] = Field(
        default="start", description="what both serve; filter: a value is minus the filter's cost, or 1 / cost of the smallest eigenvalue"
    )
    status: str
    joint: PairPart
    path_first: PairPart = Field(description="the path for all sensors, then the best schedule for it")
    sensors_first: PairPart = Field(description="the best schedule for a path taken without thinking, then the path for it")
    alternation: list[float] = Field(description="objective after every half step on the way to the answer")
    bound: Number = Field(description="no schedule for the joint path is better than this")
    gap: Number
    proof: JointBoundPart


class ValidationPart(DocumentPart):
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


class PlanPart(DocumentPart):
    """A plan made on a flight."""

    status: str
    feasible: bool = Field(description="whether it keeps every limit from where the filter believes to be")
    age: int = Field(description="how many plans ago its inputs were found")
    value: Number = Field(description="objective of the plan, what the filter knows included; null: not computed")


class FlightHistoryPart(DocumentPart):
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


class FlightPart(DocumentPart):
    """A flight that was planned anew on the way, and the same with all inputs in the middle of their ranges."""

    t: list[float]
    flown: FlightHistoryPart
    middle: FlightHistoryPart | None
    plans: list[PlanPart]
    feasible_plans: int


class Result(DocumentPart):
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
    validation: dict[str, dict[str, ValidationPart]] = Field(description="by path, then by schedule; chosen: of the question asked")
    joint: JointPart | None = Field(description="null: none was asked for")
    flight: FlightPart | None = Field(description="null: none was asked for")
    way_points: list[WayPointsPart] = Field(default=[], description="what the path costs as way points, by the points chosen")
    expected: list[Expectation]
    record: list[Any] = Field(
        default=[],
        description="the study to the last bit, from which `obsdesign report` builds the page again: its layout is that of obsdesign's own "
        "records and may change with any version; empty: left out, or the scenario has no text",
    )
    timings: dict[str, float] = Field(description="seconds per stage; the only part that varies from run to run")
