"""Tables of a scenario file: which sensors, when, and to what end."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema

import obsdesign.rules
from obsdesign.scenario.kind_tables import family_of, in_degrees_too
from obsdesign.scenario.tables import ScenarioTable

Question = Literal["filter", "start", "cheapest"]
NotNegative = Annotated[float, Field(ge=0)]

_NAMES = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}


def _as_tuple(value: Any) -> Any:  # noqa: ANN401
    return (value,) if isinstance(value, str) else tuple(value) if isinstance(value, list) else value


class RequirementTable(ScenarioTable):
    """What a filter has to know: the standard deviation of a state, or the root of the summed variances of several, is at most so much."""

    about: Annotated[tuple[str, ...], BeforeValidator(_as_tuple), WithJsonSchema(_NAMES)] = Field(
        min_length=1, description="the state, or several of one unit"
    )
    at_most: float = Field(gt=0, description="the largest standard deviation, in the unit of the states")
    share: float = Field(default=1.0, gt=0, le=1, description="at which share of the instants at least; 1 = all")
    after: float = Field(default=0.0, ge=0, description="only instants count that are later than so many seconds from the beginning")


class SelectionTable(ScenarioTable):
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
