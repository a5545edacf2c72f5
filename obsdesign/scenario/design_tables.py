"""Tables of a scenario file: how to move, and how to move and measure at once."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

import obsdesign.constraints
import obsdesign.costs
import obsdesign.paths
from obsdesign.scenario.kind_tables import family_of, flat_table
from obsdesign.scenario.tables import Positive, ScenarioTable


class PriceTable(ScenarioTable):
    """The criterion loses `per_unit` for every unit of a cost."""

    cost: family_of(obsdesign.costs)  # pyright: ignore[reportInvalidTypeForm]
    per_unit: float = Field(gt=0)


class BudgetTable(ScenarioTable):
    """A cost is at most `at_most`, in its unit."""

    cost: family_of(obsdesign.costs)  # pyright: ignore[reportInvalidTypeForm]
    at_most: float = Field(gt=0)


class FloorTable(ScenarioTable):
    """Every stretch of the path of so many seconds knows at least `value` of every combination of states."""

    seconds: float = Field(gt=0, description="length of a stretch [s]")
    value: float = Field(gt=0, description="least lambda_min of S W S of a stretch")


class RobustTable(ScenarioTable):
    """Judge the path from draws of the scenario's prior about the start."""

    samples: int = Field(default=16, ge=1)
    worst: bool = Field(default=True, description="by the worst of the draws; false: by their mean")
    seed: int = Field(default=0, ge=0)


class DesignTable(ScenarioTable):
    """How to move: what is varied, within which limits, judged by what; where paths are given, by what they are judged."""

    path: family_of(obsdesign.paths) | None = Field(  # pyright: ignore[reportInvalidTypeForm]
        default=None, description="the family of paths; needed unless [[paths]] are given"
    )
    bounds: dict[str, tuple[float, float]] = Field(default={}, description="least and largest value of an input")
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


class CodesignTable(ScenarioTable):
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
