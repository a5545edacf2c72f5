"""Known truths that a scenario carries, held against what was found."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from obsdesign.scenario.schema import Expected


class Expectation(BaseModel):
    """An entry of the scenario's [expected] list and what became of it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str = Field(description="path of the number in this document")
    value: float | int | bool | str
    tolerance: float
    source: str
    found: float | int | bool | str | None = Field(description="null: nothing stands under that key")
    met: bool


def expectations(expected: Sequence[Expected], result: Mapping[str, Any]) -> list[Expectation]:
    """Return each expected value with what the result holds under its key; a key that it does not have is not met."""
    found = [(each, _found(each.key, result)) for each in expected]
    return [Expectation(**each.model_dump(), found=value, met=_meets(each, value)) for each, value in found]


def _found(key: str, result: Any) -> Any:  # noqa: ANN401
    """The single value under a dotted key, or None."""
    value = result
    for part in key.split("."):
        try:
            value = value[int(part)] if isinstance(value, list) else value[part]
        except (KeyError, IndexError, ValueError, TypeError):
            return None
    return None if isinstance(value, (Mapping, list, tuple)) else value


def _meets(expected: Expected, found: Any) -> bool:  # noqa: ANN401
    if isinstance(expected.value, (bool, str)) or isinstance(found, (bool, str)) or found is None:
        return type(found) is type(expected.value) and found == expected.value
    return math.isclose(found, expected.value, rel_tol=0, abs_tol=expected.tolerance) or found == expected.value
