"""Scenarios of earlier formats, read as they were meant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from obsdesign.scenario.problem_text import Problem

VERSION = 1
"""Of the format of scenarios: what a file without the key `version` is."""
_Data = dict[str, Any]


@dataclass(frozen=True)
class Upgrade:
    """The data of a scenario in today's format, what was changed on the way, and what is wrong with the version given."""

    data: _Data
    changes: tuple[str, ...] = ()
    problems: tuple[Problem, ...] = ()


def upgrade_data(data: _Data) -> Upgrade:
    """Return the TOML data of a scenario in today's format; nothing is changed where its version is today's, or none."""
    version = data.get("version", VERSION)
    if not isinstance(version, int) or isinstance(version, bool) or not 0 <= version <= VERSION:
        message = f"is {version!r}: must be a whole number from 0 to {VERSION}"
        newer = "; a newer obsdesign may read it" if isinstance(version, int) and version > VERSION else ""
        return Upgrade({**data, "version": VERSION}, problems=(Problem(("version",), message + newer),))
    changes: list[str] = []
    for number in range(version, VERSION):
        data = {**_STEPS[number](data, changes), "version": number + 1}
    return Upgrade(data, tuple(changes))


def _from_0(data: _Data, changes: list[str]) -> _Data:
    """Before versions were counted: schedules served the start, and the length of a flight's plans was a number of seconds."""
    upgraded = dict(data)
    selection, flight = data.get("selection", {}), data.get("flight")
    if isinstance(selection, Mapping) and "question" not in selection:
        upgraded["selection"] = {**selection, "question": "start"}
        changes.append('selection.question = "start"')
    if isinstance(flight, Mapping) and isinstance(flight.get("horizon"), int | float):
        upgraded["flight"] = {key: value for key, value in flight.items() if key != "horizon"}
        changes.append(f"flight.horizon = {flight['horizon']} is left out: plans last time.duration")
    return upgraded


_STEPS: tuple[Callable[[_Data, list[str]], _Data], ...] = (_from_0,)
