"""Numbers that nobody means: so large that their squares overflow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from obsdesign.scenario.problem_text import Location, Problem

LARGEST = 1e100
"""Of a number, in size: squares and their products must stay below 1.8e308."""
WHOLE = 2**53
"""Of a whole number, in size: larger ones are not exact as floats, and some are no array sizes."""


def too_large(value: Any, location: Location = ()) -> Iterator[Problem]:  # noqa: ANN401  # whatever TOML can hold
    """Yield every number of TOML data that is larger than is accepted; infinite ones are left to their keys."""
    parts = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    for key, item in parts:
        yield from too_large(item, (*location, key))
    if isinstance(value, int) and abs(value) > WHOLE:
        yield Problem(
            location,
            f"is {value:.3g}: must be at most {WHOLE} in size" if abs(value) < LARGEST else _too_large_text("a number of many digits"),
        )
    if isinstance(value, float) and LARGEST < abs(value) < float("inf"):
        yield Problem(location, _too_large_text(f"{value:g}"))


def _too_large_text(shown: str) -> str:
    return f"is {shown}: must be at most {LARGEST:g} in size"
