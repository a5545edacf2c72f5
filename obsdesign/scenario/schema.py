"""The keys of a scenario file, their types and their defaults."""

from __future__ import annotations

from datetime import UTC, datetime
from math import comb, pi
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AwareDatetime, BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema

import obsdesign.constraints
import obsdesign.costs
import obsdesign.criteria
import obsdesign.paths
import obsdesign.rules
import obsdesign.sensors
import obsdesign.vehicles
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.families import leaf
from obsdesign.noise_density import PerSpeed
from obsdesign.rules.switching_cost import SwitchingCost
from obsdesign.scenario.kind_tables import family_of, flat_table, in_degrees_too
from obsdesign.sensors._corrections import system_states
from obsdesign.sensors._group import distinct_names

if TYPE_CHECKING:
    from obsdesign.dynamics.system import System
    from obsdesign.prior import Prior
    from obsdesign.rules.abstract import AbstractRule
    from obsdesign.signals import Signal


class _ScenarioTable(BaseModel):
    """A table of the file: no unknown keys, no NaN, no silent conversion."""

    # built once, as part of the whole scenario, when first used
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, defer_build=True)


STRAIGHT, SHORTEST, WEAVE, DESIGNED = "straight", "shortest", "weave", "designed"  # what a study calls its own paths
GIVEN = "given"  # and one that was read from a file
Positive = Annotated[float, Field(gt=0)]
HeightReference = Literal["sea_level", "ellipsoid"]


class Time(_ScenarioTable):
    """How long, in which steps, and how long a sensor stays chosen; all in seconds."""

    duration: float = Field(gt=0, description="length of the path [s]")
    step: float = Field(gt=0, description="integration step [s]; samples fall on steps")
    segment: float = Field(gt=0, description="how long a choice of sensors holds [s]")
    tolerance: float = Field(default=1e-6, gt=0, lt=1, description="relative error that the steps may have; sub-steps are made to meet it")


class PlaceTable(_ScenarioTable):
    """Where on Earth, and when, the scenario lies: what its metres and seconds become in files that planners and autopilots load."""

    latitude: float = Field(ge=-90, le=90, description="of a point of the plane [degrees], north > 0, WGS 84")
    longitude: float = Field(ge=-180, le=180, description="of that point [degrees], east > 0")
    altitude: float = Field(default=0.0, ge=-500, le=100_000, description="of that point [m]")
    height_reference: HeightReference = Field(
        default="sea_level",
        description="what altitude counts from: sea_level or ellipsoid (WGS 84); it is written into files, never converted",
    )
    height: float | None = Field(
        default=None, ge=-500, le=100_000, description="at which the path is flown above that point [m]; missions need it, 0 on the ground"
    )
    east: float = Field(default=0.0, ge=-1e5, le=1e5, description="how far east of that point x = y = 0 lies [m]")
    north: float = Field(default=0.0, ge=-1e5, le=1e5, description="how far north of that point x = y = 0 lies [m]")
    bearing: float = Field(
        default=pi / 2, ge=-2 * pi, le=2 * pi, description="compass bearing of the x axis [rad]; default: east, so that y points north"
    )
    begins: AwareDatetime = Field(
        default=datetime(1970, 1, 1, tzinfo=UTC), description="when t = 0 is, with its offset from UTC; default: 1970-01-01T00:00:00Z"
    )


class GrowingNoise(_ScenarioTable):
    """Process noise that grows with the speed, whose variances add up."""

    per_speed: float = Field(
        description="what there is at 1 m/s: the unit per sqrt(m), of an input times s per sqrt(m); grows as sqrt(speed)"
    )
    at_rest: float = Field(default=0.0, description="what there is without moving, as noise that does not grow is given")


class Manoeuvre(_ScenarioTable):
    """A way of moving for which the observable space is computed: known inputs held at a value."""

    name: str
    held: dict[str, float] = {}


class Baseline(_ScenarioTable):
    """A path to compare with: inputs held from start to end; those not named stay as near 0 as their bounds allow."""

    name: str = Field(min_length=1)
    inputs: dict[str, float]


class Leg(_ScenarioTable):
    """A stretch of a given path: inputs held for so many seconds; those not named are 0."""

    seconds: float = Field(gt=0, description="[s]")
    inputs: dict[str, float] = {}


class GivenPath(_ScenarioTable):
    """A path that is given instead of designed: from the start, leg by leg, time.duration in all."""

    name: str = Field(min_length=1)
    legs: tuple[Leg, ...] = Field(min_length=1)


class PriceTable(_ScenarioTable):
    """The criterion loses `per_unit` for every unit of a cost."""

    cost: family_of(obsdesign.costs)  # pyright: ignore[reportInvalidTypeForm]
    per_unit: float = Field(gt=0)


class BudgetTable(_ScenarioTable):
    """A cost is at most `at_most`, in its unit."""

    cost: family_of(obsdesign.costs)  # pyright: ignore[reportInvalidTypeForm]
    at_most: float = Field(gt=0)


class FloorTable(_ScenarioTable):
    """Every stretch of the path of so many seconds knows at least `value` of every combination of states."""

    seconds: float = Field(gt=0, description="length of a stretch [s]")
    value: float = Field(gt=0, description="least lambda_min of S W S of a stretch")


class RobustTable(_ScenarioTable):
    """Judge the path from draws of the scenario's prior about the start."""

    samples: int = Field(default=16, ge=1)
    worst: bool = Field(default=True, description="by the worst of the draws; false: by their mean")
    seed: int = Field(default=0, ge=0)


class DesignTable(_ScenarioTable):
    """How to move: what is varied, within which limits, judged by what; where paths are given, by what they are judged."""

    path: family_of(obsdesign.paths) | None = Field(  # pyright: ignore[reportInvalidTypeForm]
        default=None, description="the family of paths; needed unless [[paths]] are given"
    )
    bounds: dict[str, tuple[float, float]] = {}
    rates: dict[str, Positive] = Field(default={}, description="largest change per second of an input")
    criterion: str = "min_eigenvalue"
    posterior_criterion: str = Field(
        default="min_eigenvalue", description="what a posterior is judged by: min_eigenvalue, log_det or trace_inverse"
    )
    over: Literal["end", "mean", "worst"] | tuple[float, ...] = Field(
        default="end",
        description="when a posterior is judged: at the end, by the mean or the worst of all instants, or by weights, one for each step",
    )
    about: tuple[str, ...] = Field(default=(), description="the states that are judged while the others are found as well; default: all")
    starts: int = Field(default=8, ge=1)
    gap: float | None = Field(
        default=None, ge=0, lt=1, description="starts go on until the path is this near to its bound, 8 times `starts` at most"
    )
    evidence: int = Field(default=0, ge=0, description="climbs that ask how much better another path might be")
    shortest: float | None = Field(default=None, gt=0, description="the path may be as short as this [s]; default: time.duration")
    suites: tuple[tuple[str, ...], ...] = Field(default=(), description="sensor suites to report beside all sensors")
    constraints: tuple[family_of(obsdesign.constraints), ...] = ()  # pyright: ignore[reportInvalidTypeForm]
    prices: tuple[Annotated[PriceTable, *flat_table("per_unit")], ...] = ()
    budgets: tuple[Annotated[BudgetTable, *flat_table("at_most")], ...] = ()
    floor: FloorTable | None = None
    robust: RobustTable | None = None


Question = Literal["filter", "start", "cheapest"]
NotNegative = Annotated[float, Field(ge=0)]
_FILTER_GAP = 1e-3  # to which a schedule for the filter is proven, unless the file says otherwise
_MAX_SETS = 1000  # sets of sensors that a schedule for the filter chooses from

_NAMES = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}


def _as_tuple(value: Any) -> Any:  # noqa: ANN401
    return (value,) if isinstance(value, str) else tuple(value) if isinstance(value, list) else value


class RequirementTable(_ScenarioTable):
    """What a filter has to know: the standard deviation of a state, or the root of the summed variances of several, is at most so much."""

    about: Annotated[tuple[str, ...], BeforeValidator(_as_tuple), WithJsonSchema(_NAMES)] = Field(
        min_length=1, description="the state, or several of one unit"
    )
    at_most: float = Field(gt=0, description="the largest standard deviation, in the unit of the states")
    share: float = Field(default=1.0, gt=0, le=1, description="at which share of the instants at least; 1 = all")
    after: float = Field(default=0.0, ge=0, description="only instants count that are later than so many seconds from the beginning")


class SelectionTable(_ScenarioTable):
    """Which sensors, when, and to what end."""

    question: Question | None = Field(
        default=None,
        description="whom a schedule serves: filter = what a filter knows along the way, start = what all samples say of the state at the "
        "start, cheapest = what [[selection.requirements]] ask of a filter, at the least cost; default: cheapest where there are "
        "requirements, else filter where [process_noise] is given and nothing is asked that only start knows, else start",
    )
    requirements: tuple[Annotated[RequirementTable, *in_degrees_too("at_most")], ...] = Field(
        default=(), description="what a filter has to know along the way: the cheapest schedule that keeps all of it is looked for"
    )
    cost: dict[str, NotNegative] | None = Field(
        default=None,
        description="what each sensor costs per segment that it is on, 0 for those left out; default: 1 each, fewest segments on",
    )
    start: dict[str, NotNegative] = Field(default={}, description="what it costs to switch a sensor on, in the unit of cost")
    over: Literal["mean", "worst", "end"] | tuple[float, ...] = Field(
        default="mean",
        description="which instants count for the filter: the mean of all, the worst, the last, or weights, one for each step",
    )
    per_segment: int = Field(default=1, ge=1, description="how many sensors may be on at a time")
    criterion: str = Field(
        default="min_eigenvalue",
        description="min_eigenvalue, log_det or trace_inverse, of the information or of the filter's covariance; default: min_eigenvalue "
        "for the start, trace_inverse, the sum of the variances, for the filter",
    )
    robust_to: int = Field(default=0, ge=0, description="how many sensors may be lost, whichever they are: the worst loss counts")
    gap: float = Field(
        default=1e-9,
        ge=0,
        description="the search ends when the schedule is proven to be within this of the best; default: 1e-9, for the filter 1e-3",
    )
    pareto: int = Field(
        default=0, ge=0, description="points of the front of information about the start against what an energy_budget counts"
    )
    rules: tuple[family_of(obsdesign.rules), ...] = ()  # pyright: ignore[reportInvalidTypeForm]
    naive: Annotated[tuple[str, ...], BeforeValidator(_as_tuple), WithJsonSchema(_NAMES)] = Field(
        default=(), description="the sensor, or per_segment of them, that the naive schedule keeps on; default: the first"
    )


class CodesignTable(_ScenarioTable):
    """Choose path and schedule together, beside the one after the other."""

    question: Literal["filter", "start"] | None = Field(
        default=None,
        description="what both serve: filter = what a filter knows along the way, start = what all samples say of the state at the start; "
        "default: as [selection], filter where that asks for the cheapest schedule",
    )
    starts: int = Field(default=4, ge=1, description="starts of each design, and of the search with relaxed schedules")
    gap: float | None = Field(
        default=None, ge=0, lt=1, description="the bound branches on segments until it is that near to the value, 200 nodes at most"
    )


class FlightTable(_ScenarioTable):
    """A flight with the filter in the loop, planned anew again and again from what it believes."""

    every: float = Field(gt=0, description="time from one plan to the next [s]")
    duration: float = Field(gt=0, description="length of the flight [s]")
    horizon: Literal["receding", "shrinking"] = Field(
        default="receding", description="each plan lasts time.duration from then on, or until time.duration is over"
    )


class ValidationTable(_ScenarioTable):
    """The Monte Carlo runs of the filter."""

    runs: int = Field(default=200, ge=2)


class ReplayTable(_ScenarioTable):
    """How a log is replayed."""

    gate: float = Field(default=0.999, gt=0, lt=1, description="share of the samples that the filter takes in where all is as modelled")
    window: float = Field(default=10.0, gt=0, description="length of a window [s]")
    about: tuple[str, ...] = Field(default=("x", "y"), min_length=1, description="the states that count")
    along: Literal["truth", "estimate"] | None = Field(
        default=None, description="where information is taken; default: along the truth where the log has one of the states that count"
    )
    restarts: int = Field(
        default=32, ge=0, description="filters that begin anew in each window, where there is truth; 0: windows of one run"
    )
    calibrate: float = Field(
        default=0.5, ge=0, le=1, description="share of the log that noises, biases and scales are found from; 0: they are those of the file"
    )
    topics: str = Field(default="", description="TOML file, beside the scenario, that says which topics and fields the log's file are what")
    schedule: bool = Field(default=True, description="choose sensors as well: selection.per_segment for time.segment each")


class Expected(_ScenarioTable):
    """A known truth: the number under `key` in result.json, to within `tolerance`, from `source`."""

    key: str
    value: float | int | bool | str
    tolerance: float = Field(default=0.0, ge=0)
    source: str


class Scenario(_ScenarioTable):
    """A study as read from its file. Every angle may be given in degrees under its key with the suffix _deg."""

    version: Literal[1] = Field(default=1, description="of the format of scenarios; files of earlier ones are read as they were meant")
    title: str
    """What the study is called."""
    question: str
    """What it is to answer, in words."""
    seed: int = Field(default=0, ge=0)
    """Seed of everything that is drawn."""
    vehicle: family_of(obsdesign.vehicles)  # pyright: ignore[reportInvalidTypeForm]
    """What moves, by its kind and values."""
    sensors: tuple[family_of(obsdesign.sensors), ...] = Field(min_length=1)  # pyright: ignore[reportInvalidTypeForm]
    """What measures, each by its kind and values."""
    start: dict[str, float]
    """Initial value of each state, in its unit."""
    prior: dict[str, float] = Field(description="standard deviation of each state before the first measurement")
    process_noise: dict[str, float | GrowingNoise] = Field(
        default={},
        description="unit per sqrt(s) of each state that has any, unit times sqrt(s) of each known input; or { per_speed, at_rest } of it",
    )
    time: Time
    """Duration, step and segment [s]."""
    place: Annotated[PlaceTable, *in_degrees_too("bearing")] | None = None
    """Where on Earth the scenario lies; None = nowhere, so that paths are written in metres only."""
    manoeuvres: tuple[Manoeuvre, ...] = Field(default_factory=lambda: (Manoeuvre(name="free"),))
    """Ways of moving for which the observable space is computed."""
    baselines: tuple[Baseline, ...] = Field(default=(), description="paths to compare with; the first is the naive one")
    paths: tuple[GivenPath, ...] = Field(default=(), description="paths that are studied as they are; then nothing is designed")
    design: DesignTable = Field(default_factory=DesignTable)
    """How to move: family of paths, limits, criterion."""
    selection: SelectionTable = Field(default_factory=SelectionTable)
    """Which sensors when: number, rules, criterion."""
    validation: ValidationTable = Field(default_factory=ValidationTable)
    """Monte Carlo runs of the filter."""
    codesign: CodesignTable | None = None
    """Path and schedule chosen together; None = not asked for."""
    flight: FlightTable | None = None
    """A flight with the filter in the loop; None = not asked for."""
    replay: ReplayTable = Field(default_factory=ReplayTable)
    """How a log is replayed; a file that has this table needs no [design], [start] and [time]."""
    expected: tuple[Expected, ...] = ()
    """Known truths that the result is compared with."""
    file: str = Field(default="", exclude=True, description="where it was read; set by load_scenario")
    digest: str = Field(default="", description="sha256 of the file; set by load_scenario")
    source: str = Field(default="", exclude=True, description="text of the file; set by load_scenario")

    @property
    def system(self) -> System:
        """The vehicle with all its sensors."""
        from obsdesign.dynamics.system import System

        return System(self.vehicle, self.sensors)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the n states."""
        return tuple(signal.name for signal in self.states)

    @property
    def states(self) -> tuple[Signal, ...]:
        """The n states: those of the vehicle, then scales and biases of sensors."""
        return system_states(self.vehicle.states, (*self.vehicle.inputs, *self.vehicle.disturbances), self.sensors)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Names of the S sensors; two of one name are told apart by a number."""
        return distinct_names(self.sensors)

    @property
    def criterion(self) -> AbstractCriterion:
        """What the design is judged by; the posterior with the scenario's own prior and process noise."""
        kind, design = leaf(obsdesign.criteria, self.design.criterion), self.design
        if design.criterion != "posterior":
            return kind()
        judged_by = leaf(obsdesign.criteria, design.posterior_criterion)()
        return kind(self.prior_at_start, self.disturbance_psd, criterion=judged_by, over=design.over, input_psd=self.input_psd)

    @property
    def prior_at_start(self) -> Prior:
        """N(x(t_0), diag(std^2))."""
        from obsdesign.prior import Prior

        names = self.state_names
        return Prior([self.start[name] for name in names], std=[self.prior[name] for name in names])

    @property
    def disturbance_psd(self) -> tuple[float, ...] | PerSpeed:
        """Power spectral density (n,) of the process noise, unit^2/s."""
        at_rest, growing = zip(*(self._psd_of(name) for name in self.state_names), strict=True)
        return PerSpeed(growing, at_rest) if any(growing) else at_rest

    @property
    def input_psd(self) -> dict[str, float | PerSpeed]:
        """Power spectral density of the noise of known inputs, unit^2 s, for those that have any."""
        psds = {name: self._psd_of(name) for name in self.process_noise if name not in self.state_names}
        return {name: PerSpeed(growing, at_rest) if growing else at_rest for name, (at_rest, growing) in psds.items() if growing or at_rest}

    def _psd_of(self, name: str) -> tuple[float, float]:
        """Return the psd of a state or an input at rest, and what it has more at 1 m/s."""
        noise = self.process_noise.get(name, 0.0)
        return (noise.at_rest**2, noise.per_speed**2) if isinstance(noise, GrowingNoise) else (noise**2, 0.0)

    @property
    def schedule_criterion(self) -> AbstractCriterion:
        """What a schedule is judged by."""
        return leaf(obsdesign.criteria, self.selection.criterion)()

    @property
    def schedule_question(self) -> Question:
        """Whom the schedule serves: the filter along the way, information about the start, or what is required at the least cost."""
        settings = self.selection
        if settings.question is not None:
            return settings.question
        if settings.requirements:
            return "cheapest"
        is_for_filter = any(any(self._psd_of(name)) for name in self.process_noise) and not settings.robust_to and self.has_filter_schedule
        return "filter" if is_for_filter else "start"

    @property
    def has_filter_schedule(self) -> bool:
        """Whether the sets of sensors that may be on are few enough for a schedule for the filter."""
        sensors, per_segment = len(self.sensor_names), self.selection.per_segment
        return sum(comb(sensors, size) for size in range(min(per_segment, sensors) + 1)) <= _MAX_SETS

    @property
    def filter_criterion_kind(self) -> str:
        """Kind of what the covariance of a filter is judged by."""
        return self.selection.criterion if "criterion" in self.selection.model_fields_set else "trace_inverse"

    @property
    def filter_criterion(self) -> AbstractCriterion:
        """What the covariance of a filter is judged by."""
        return leaf(obsdesign.criteria, self.filter_criterion_kind)()

    @property
    def codesign_question(self) -> Literal["filter", "start"]:
        """What path and schedule serve that are chosen together."""
        if self.codesign is not None and self.codesign.question is not None:
            return self.codesign.question
        return "start" if self.schedule_question == "start" else "filter"

    @property
    def codesign_criterion(self) -> AbstractCriterion:
        """What path and schedule are judged by that are chosen together: for a filter the cost that `[selection]` minimises."""
        if self.codesign_question == "start":
            return self.criterion
        judged_by, over = self.filter_criterion, self.selection.over
        posterior = leaf(obsdesign.criteria, "posterior")
        return posterior(self.prior_at_start, self.disturbance_psd, criterion=judged_by, over=over, input_psd=self.input_psd)

    @property
    def filter_gap(self) -> float:
        """How near to the best a schedule for the filter, and a cheapest one, is to be proven."""
        is_given = "gap" in self.selection.model_fields_set and self.schedule_question != "start"
        return self.selection.gap if is_given else _FILTER_GAP

    def rules_for(self, question: Question) -> tuple[AbstractRule, ...]:
        """Return the rules that count for a question: what switching costs is in the unit of the one that is asked."""
        is_asked = question == self.schedule_question
        return tuple(rule for rule in self.selection.rules if is_asked or not isinstance(rule, SwitchingCost))

    @property
    def naive_sensors(self) -> tuple[str, ...]:
        """The sensors that the naive schedule keeps on."""
        return self.selection.naive or self.sensor_names[: self.selection.per_segment]

    @property
    def shortest(self) -> float:
        """The shortest duration of a path [s]; the longest is time.duration."""
        return self.time.duration if self.design.shortest is None else self.design.shortest

    @property
    def segments(self) -> int:
        """K of the longest path."""
        return round(self.time.duration / self.time.segment)

    @property
    def steps(self) -> int:
        """N of the longest path."""
        return round(self.time.duration / self.time.step)
