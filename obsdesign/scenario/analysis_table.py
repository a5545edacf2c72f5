"""The table [analysis] of a scenario: for which sensors, disturbances and points the observable space is computed."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from obsdesign.scenario.tables import ScenarioTable

Degree = Annotated[int, Field(ge=0, le=20)]


class AnalysisTable(ScenarioTable):
    """What `obsdesign analyse` looks at; the ways of moving are [[manoeuvres]]."""

    subsets: tuple[Annotated[tuple[str, ...], Field(min_length=1)], ...] = Field(
        default=(),
        description="sensors that are looked at together; default: every subset; of more than 5 sensors each alone, all but one, and all",
    )
    disturbances: tuple[Literal["arbitrary"] | Degree, ...] = Field(
        default=("arbitrary",),
        min_length=1,
        description="what unknown inputs may be: arbitrary = any smooth functions of time; a number = polynomials of that degree in it, "
        "0 = constants",
    )
    known_inputs: Literal["any", "smooth"] = Field(
        default="any", description="any = known inputs may switch; smooth = one smooth signal, to which the unknown inputs may react"
    )
    point: Literal["start", "generic"] | dict[str, float] = Field(
        default="start",
        description="which state is asked about: start, generic = almost every one, or a value for each state; "
        "default: start where the file has [start]",
    )
    known_at_start: tuple[str, ...] = Field(default=(), description="states that are known when the sensors begin")
