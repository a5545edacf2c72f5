"""The keys of a scenario file, their types and their defaults."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, Union

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag

import obsdesign.constraints
import obsdesign.criteria
import obsdesign.paths
import obsdesign.sensors
import obsdesign.vehicles
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.families import kinds, leaf
from obsdesign.sensors.abstract import distinct_names

if TYPE_CHECKING:
    from obsdesign.prior import Prior
    from obsdesign.system import System

# every class that a table may name under `kind`
LEAVES = {
    kind: leaf(package, kind)
    for package in (obsdesign.vehicles, obsdesign.sensors, obsdesign.paths, obsdesign.constraints)
    for kind in kinds(package)
}


def _family(package: ModuleType) -> Any:  # noqa: ANN401  # a type made at run time
    """Return the union of a family's leaves, told apart by the key `kind`."""

    def kind_of(table: Any) -> str | None:  # noqa: ANN401
        return table.get("kind") if isinstance(table, dict) else None

    def without_kind(table: dict[str, Any]) -> dict[str, Any]:
        return {key: _tuples(value) for key, value in table.items() if key != "kind"}

    members = [Annotated[LEAVES[kind], BeforeValidator(without_kind), Tag(kind)] for kind in kinds(package)]
    # a second, empty tag: a union of one member is no union
    return Annotated[Union[(*members, Annotated[None, Tag("")])], Discriminator(kind_of)]


def _tuples(value: Any) -> Any:  # noqa: ANN401
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value


class _Table(BaseModel):
    """A table of the file: no unknown keys, no NaN, no silent conversion."""

    # built once, as part of the whole scenario, when first used
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, defer_build=True)


class Time(_Table):
    """How long, in which steps, and how long a sensor stays chosen; all in seconds."""

    duration: float = Field(gt=0, description="length of the path [s]")
    step: float = Field(gt=0, description="integration step [s]; samples fall on steps")
    segment: float = Field(gt=0, description="how long a choice of sensors holds [s]")


class Manoeuvre(_Table):
    """A way of moving for which the observable space is computed: known inputs held at a value."""

    name: str
    held: dict[str, float] = {}


class DesignTable(_Table):
    """How to move: what is varied, within which limits, judged by what."""

    path: _family(obsdesign.paths)  # pyright: ignore[reportInvalidTypeForm]
    bounds: dict[str, tuple[float, float]]
    criterion: str = "min_eigenvalue"
    starts: int = Field(default=8, ge=1)
    suites: tuple[tuple[str, ...], ...] = Field(default=(), description="sensor suites to report beside all sensors")
    constraints: tuple[_family(obsdesign.constraints), ...] = ()  # pyright: ignore[reportInvalidTypeForm]


class SelectionTable(_Table):
    """Which sensors, when."""

    per_segment: int = Field(default=1, ge=1)
    naive: str | None = Field(default=None, description="the sensor that the naive schedule keeps on; default: the first")


class ValidationTable(_Table):
    """The Monte Carlo runs of the filter."""

    runs: int = Field(default=200, ge=2)


class Expected(_Table):
    """A known truth: the number under `key` in result.json, to within `tolerance`, from `source`."""

    key: str
    value: float | int | bool | str
    tolerance: float = Field(default=0.0, ge=0)
    source: str


class Scenario(_Table):
    """A study as read from its file. Every angle may be given in degrees under its key with the suffix _deg."""

    title: str
    question: str
    seed: int = Field(default=0, ge=0)
    vehicle: _family(obsdesign.vehicles)  # pyright: ignore[reportInvalidTypeForm]
    sensors: tuple[_family(obsdesign.sensors), ...] = Field(min_length=1)  # pyright: ignore[reportInvalidTypeForm]
    start: dict[str, float]
    prior: dict[str, float] = Field(description="standard deviation of each state before the first measurement")
    process_noise: dict[str, float] = Field(default={}, description="unit per sqrt(s), for each state that has any")
    time: Time
    manoeuvres: tuple[Manoeuvre, ...] = Field(default_factory=lambda: (Manoeuvre(name="free"),))
    design: DesignTable
    selection: SelectionTable = Field(default_factory=SelectionTable)
    validation: ValidationTable = Field(default_factory=ValidationTable)
    expected: tuple[Expected, ...] = ()
    file: str = Field(default="", exclude=True, description="where it was read; set by load_scenario")
    digest: str = Field(default="", description="sha256 of the file; set by load_scenario")

    @property
    def system(self) -> System:
        """The vehicle with all its sensors."""
        from obsdesign.system import System

        return System(self.vehicle, self.sensors)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the n states."""
        return tuple(signal.name for signal in self.vehicle.states)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Names of the S sensors; two of one name are told apart by a number."""
        return distinct_names(self.sensors)

    @property
    def criterion(self) -> AbstractCriterion:
        """What the design is judged by; the posterior with the scenario's own prior and process noise."""
        kind = leaf(obsdesign.criteria, self.design.criterion)
        return kind(self.prior_at_start, self.disturbance_psd) if self.design.criterion == "posterior" else kind()

    @property
    def prior_at_start(self) -> Prior:
        """N(x(t_0), diag(std^2))."""
        from obsdesign.prior import Prior

        names = self.state_names
        return Prior([self.start[name] for name in names], std=[self.prior[name] for name in names])

    @property
    def disturbance_psd(self) -> tuple[float, ...]:
        """Power spectral density (n,) of the process noise, unit^2/s."""
        return tuple(self.process_noise.get(name, 0.0) ** 2 for name in self.state_names)

    @property
    def segments(self) -> int:
        """K."""
        return round(self.time.duration / self.time.segment)

    @property
    def steps(self) -> int:
        """N."""
        return round(self.time.duration / self.time.step)
