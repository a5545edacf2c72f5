"""On which line of a TOML file a key stands: found by reading the file's beginnings, so that TOML's own reader decides."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any

from obsdesign.scenario.problem_text import Location, value_at

# what a line that begins a statement looks like: the name of a table, or a key
_STATEMENT = re.compile(r"""\s*(\[\[?[^\[\],]+\]\]?\s*(\#.*)?$|[\w."'-][\w\s."'-]*=)""")
_TRIES = 40  # beginnings that may end within a value until the search is given up: more in a row are no file of a person


def line_of(text: str, location: Location) -> int | None:
    """Return the line, from 1, on which the value at a location begins; of a key that is missing, where the table around it does.

    A beginning of the file that is TOML by itself holds a key or does not, and longer ones hold what shorter ones do: bisection over
    the lines that look as if a statement began there. None: nothing of the location stands in the file, or it was not found.
    """
    lines, whole = [f"{line}\n" for line in text.split("\n")], tomllib.loads(text)
    while location and value_at(whole, location) is None:
        location = location[:-1]
    starts = [number for number, line in enumerate(lines) if _STATEMENT.match(line)]
    low, high = 0, len(starts) - 1  # the statement is at starts[low] at the earliest, at starts[high] at the latest
    while location and low < high:
        split = _split(lines, starts, low, high)
        if split is None:
            break
        index, data = split
        low, high = (low, index - 1) if value_at(data, location) is not None else (index, high)
    return starts[low] + 1 if location and 0 <= high - low <= _TRIES else None


def _split(lines: list[str], starts: list[int], low: int, high: int) -> tuple[int, Mapping[str, Any]] | None:
    """Return a statement between two, near the middle, and what all before it say; None where only values' insides lie between."""
    middle = (low + high + 1) // 2
    for index in [*range(middle, low, -1), *range(middle + 1, high + 1)][:_TRIES]:
        try:
            return index, tomllib.loads("".join(lines[: starts[index]]))
        except tomllib.TOMLDecodeError:  # what looked like a statement stands within a value
            continue
    return None
