"""The scenario: its tables, and what follows from them."""

from __future__ import annotations

from functools import cached_property
from math import comb
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import ConfigDict, Field

import obsdesign.criteria
import obsdesign.sensors
import obsdesign.vehicles
from obsdesign.families import leaf
from obsdesign.scenario.analysis_table import AnalysisTable
from obsdesign.scenario.design_tables import CodesignTable, DesignTable
from obsdesign.scenario.kind_tables import family_of, in_degrees_too
from obsdesign.scenario.log_schema import require_unless_replayed
from obsdesign.scenario.selection_tables import Question, SelectionTable
from obsdesign.scenario.system_tables import SystemTable
from obsdesign.scenario.tables import (
    Baseline,
    Expected,
    FlightTable,
    GivenPath,
    GrowingNoise,
    Manoeuvre,
    PlaceTable,
    ReplayTable,
    ScenarioTable,
    SweepTable,
    Time,
    ValidationTable,
)
from obsdesign.sensors._corrections import system_states
from obsdesign.sensors._group import distinct_names

if TYPE_CHECKING:
    from obsdesign.criteria.abstract import AbstractCriterion
    from obsdesign.dynamics.system import System
    from obsdesign.dynamics.system_text import SystemText
    from obsdesign.dynamics.text_system import TextSystem
    from obsdesign.noise_density import PerSpeed
    from obsdesign.prior import Prior
    from obsdesign.rules.abstract import AbstractRule
    from obsdesign.signals import Point, Signal

_FILTER_GAP = 1e-3  # to which a schedule for the filter is proven, unless the file says otherwise
_MAX_SETS = 1000  # sets of sensors that a schedule for the filter chooses from


class Scenario(ScenarioTable):
    """A study as read from its file. Every angle may be given in degrees under its key with the suffix _deg."""

    model_config = ConfigDict(json_schema_extra=require_unless_replayed)

    version: Literal[1] = Field(default=1, description="of the format of scenarios; files of earlier ones are read as they were meant")
    title: str
    """What the study is called."""
    question: str
    """What it is to answer, in words."""
    seed: int = Field(default=0, ge=0)
    """Seed of everything that is drawn."""
    system_table: SystemTable | None = Field(
        default=None, alias="system", description="a system as text, states, rates and outputs as formulas; in place of vehicle and sensors"
    )
    vehicle: family_of(obsdesign.vehicles) | None = Field(  # pyright: ignore[reportInvalidTypeForm]
        default=None, description="what moves, by its kind and values"
    )
    sensors: tuple[family_of(obsdesign.sensors), ...] = Field(  # pyright: ignore[reportInvalidTypeForm]
        default=(), description="what measures, each by its kind and values", json_schema_extra={"minItems": 1}
    )
    unknown_inputs: tuple[str, ...] = Field(default=(), description="inputs of the vehicle that nobody knows; of a [system]: its `unknown`")
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
    analysis: AnalysisTable = Field(default_factory=AnalysisTable)
    """What verdicts are asked of; a file that has this table and no [start] needs no [prior], [time] and [design]."""
    sweep: SweepTable | None = None
    """What a sweep of it varies; None = nothing."""
    expected: tuple[Expected, ...] = ()
    """Known truths that the result is compared with."""
    file: str = Field(default="", exclude=True, description="where it was read; set by load_scenario")
    digest: str = Field(default="", description="sha256 of the file; set by load_scenario")
    source: str = Field(default="", exclude=True, description="text of the file; set by load_scenario")

    @property
    def system(self) -> System | TextSystem:
        """The vehicle with all its sensors, or the system that is given as text."""
        if self.system_text is not None:
            from obsdesign.dynamics.text_system import TextSystem

            return TextSystem(self.system_text)
        from obsdesign.dynamics.system import System

        return System(self.vehicle, self.sensors, self.unknown_inputs)  # pyright: ignore[reportArgumentType]  # there is a vehicle where there is no text

    @cached_property
    def system_text(self) -> SystemText | None:
        """The system as text; None where there are a vehicle and sensors."""
        return None if self.system_table is None else self.system_table.system_text

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the n states."""
        return tuple(signal.name for signal in self.states)

    @property
    def states(self) -> tuple[Signal, ...]:
        """The n states: those of the vehicle, then scales and biases of sensors."""
        if self.vehicle is None:
            return self.moving_states
        return system_states(self.vehicle.states, (*self.vehicle.inputs, *self.vehicle.disturbances), self.sensors)

    @property
    def moving_states(self) -> tuple[Signal, ...]:
        """The states without scales and biases of sensors."""
        return self._signals_of("states") if self.system_text is None else self.system_text.state_signals

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """The known inputs."""
        if self.system_text is not None:
            return self.system_text.input_signals
        return tuple(signal for signal in self._signals_of("inputs") if signal.name not in self.unknown_inputs)

    def _signals_of(self, what: Literal["states", "inputs"]) -> tuple[Signal, ...]:
        """Those of the vehicle."""
        return () if self.vehicle is None else getattr(self.vehicle, what)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Names of the S sensors; two of one name are told apart by a number."""
        return distinct_names(self.sensors) if self.system_table is None else tuple(self.system_table.outputs)

    @property
    def sample_rates(self) -> dict[tuple[str | int, ...], float | None]:
        """Samples per second [Hz] of each sensor, None = one every step, by where that stands in the file."""
        if self.system_table is not None:
            return {("system", "outputs", name, "rate"): output.rate for name, output in self.system_table.outputs.items()}
        return {("sensors", i, "rate"): sensor.rate for i, sensor in enumerate(self.sensors)}

    @property
    def landmarks(self) -> tuple[Point, ...]:
        """Points that sensors look at."""
        text = self.system_text
        if text is not None:
            return tuple(point for output in text.outputs for point in text.points_of(output))
        return tuple(point for sensor in self.sensors for point in sensor.landmarks)

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
        from obsdesign.noise_density import PerSpeed

        at_rest, growing = zip(*(self._psd_of(name) for name in self.state_names), strict=True)
        return PerSpeed(growing, at_rest) if any(growing) else at_rest

    @property
    def input_psd(self) -> dict[str, float | PerSpeed]:
        """Power spectral density of the noise of known inputs, unit^2 s, for those that have any."""
        from obsdesign.noise_density import PerSpeed

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
        from obsdesign.rules.switching_cost import SwitchingCost

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
