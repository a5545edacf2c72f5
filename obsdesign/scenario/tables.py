"""Tables of a scenario file: when and where, ways of moving that are given, the checks."""

from __future__ import annotations

from datetime import UTC, datetime
from math import pi
from typing import Annotated, Any, Literal

from pydantic import AwareDatetime, BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema

from obsdesign.scenario.log_schema import without_times

Positive = Annotated[float, Field(gt=0)]
HeightReference = Literal["sea_level", "ellipsoid"]


class ScenarioTable(BaseModel):
    """A table of the file: no unknown keys, no NaN, no silent conversion."""

    # built once, as part of the whole scenario, when first used
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, defer_build=True)


class Time(ScenarioTable):
    """How long, in which steps, and how long a sensor stays chosen; all in seconds."""

    model_config = ConfigDict(json_schema_extra=without_times)

    duration: float = Field(gt=0, description="length of the path [s]")
    step: float = Field(gt=0, description="integration step [s]; samples fall on steps")
    segment: float = Field(gt=0, description="how long a choice of sensors holds [s]")
    tolerance: float = Field(default=1e-6, gt=0, lt=1, description="relative error that the steps may have; sub-steps are made to meet it")


class PlaceTable(ScenarioTable):
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


class GrowingNoise(ScenarioTable):
    """Process noise that grows with the speed, whose variances add up."""

    per_speed: float = Field(
        description="what there is at 1 m/s: the unit per sqrt(m), of an input times s per sqrt(m); grows as sqrt(speed)"
    )
    at_rest: float = Field(default=0.0, description="what there is without moving, as noise that does not grow is given")


class Manoeuvre(ScenarioTable):
    """A way of moving for which the observable space is computed: known inputs held at a value."""

    name: str
    held: dict[str, float] = {}


class Baseline(ScenarioTable):
    """A path to compare with: inputs held from start to end; those not named stay as near 0 as their bounds allow."""

    name: str = Field(min_length=1)
    inputs: dict[str, float]


class Leg(ScenarioTable):
    """A stretch of a given path: inputs held for so many seconds; those not named are 0."""

    seconds: float = Field(gt=0, description="[s]")
    inputs: dict[str, float] = {}


class GivenPath(ScenarioTable):
    """A path that is given instead of designed: from the start, leg by leg, time.duration in all."""

    name: str = Field(min_length=1)
    legs: tuple[Leg, ...] = Field(min_length=1)


class FlightTable(ScenarioTable):
    """A flight with the filter in the loop, planned anew again and again from what it believes."""

    every: float = Field(gt=0, description="time from one plan to the next [s]")
    duration: float = Field(gt=0, description="length of the flight [s]")
    horizon: Literal["receding", "shrinking"] = Field(
        default="receding", description="each plan lasts time.duration from then on, or until time.duration is over"
    )


class ValidationTable(ScenarioTable):
    """The Monte Carlo runs of the filter."""

    runs: int = Field(default=200, ge=2)


class ReplayTable(ScenarioTable):
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


def _join_keys(value: Any, prefix: str = "") -> Any:  # noqa: ANN401  # whatever TOML can hold
    """Return tables within tables as one, whose keys are joined by dots: `sensors.gps.sigma` needs no quotes in a file."""
    if not isinstance(value, dict):
        return {prefix: tuple(value) if isinstance(value, list) else value}
    return {key: item for name, part in value.items() for key, item in _join_keys(part, f"{prefix}.{name}" if prefix else name).items()}


class SweepTable(ScenarioTable):
    """What `obsdesign sweep` varies: every combination of the values of all keys is run."""

    vary: Annotated[
        dict[str, Annotated[tuple[Any, ...], Field(min_length=1)]], BeforeValidator(_join_keys), WithJsonSchema({"type": "object"})
    ] = Field(
        min_length=1,
        description="values by key; a key is a path of names joined by dots, a sensor under its name: sensors.gps.sigma = [1, 2]; "
        "sensors: lists of those that stay",
    )


class Expected(ScenarioTable):
    """A known truth: the number under `key` in result.json, to within `tolerance`, from `source`."""

    key: str
    value: float | int | bool | str
    tolerance: float = Field(default=0.0, ge=0)
    source: str
