"""Known truths that a scenario carries, held against what was found."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from obsdesign.scenario.tables import Expected


class Expectation(BaseModel):
    """An entry of the scenario's [expected] list and what became of it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str = Field(description="path of the number in this document")
    value: float | int | bool | str
    tolerance: float
    source: str
    found: float | int | bool | str | None = Field(description="null: nothing stands under that key")
    met: bool


def check_expectations(expected: Sequence[Expected], result: Mapping[str, Any]) -> list[Expectation]:
    """Return each expected value with what the result holds under its key; a key that it does not have is not met."""
    pairs = [(entry, _value_at(entry.key, result)) for entry in expected]
    return [Expectation(**entry.model_dump(), found=value, met=_is_met(entry, value)) for entry, value in pairs]


def unmet_lines(expected: Sequence[Expectation], file: str) -> tuple[str, ...]:
    """Return a line for each known truth that the result in `file` misses."""
    return tuple(
        f"expected {entry.key} = {entry.value} within {entry.tolerance} ({entry.source}): "
        + (f"no such key in {file}" if entry.found is None else f"found {entry.found}")
        for entry in expected
        if not entry.met
    )


def _value_at(key: str, result: Any) -> Any:  # noqa: ANN401
    """The single value under a dotted key, or None."""
    value = result
    for part in key.split("."):
        try:
            value = value[int(part)] if isinstance(value, list) else value[part]
        except (KeyError, IndexError, ValueError, TypeError):
            return None
    return None if isinstance(value, (Mapping, list, tuple)) else value


def _is_met(expected: Expected, actual: Any) -> bool:  # noqa: ANN401
    if isinstance(expected.value, (bool, str)) or isinstance(actual, (bool, str)) or actual is None:
        return type(actual) is type(expected.value) and actual == expected.value
    return math.isclose(actual, expected.value, rel_tol=0, abs_tol=expected.tolerance) or actual == expected.value
