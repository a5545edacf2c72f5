"""The numbers of a result that one lays beside those of other runs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

Scalar = float | int | bool | str | None
_WORDS = (  # of a key: what it is called, and whether more is better (1) or less (-1)
    (r"analyses\.(.*)\.[^.]*\.dimension", "combinations of states that are seen, {}", 1),
    (r"designs\.(.*)\.value", "value of the designed path, sensors: {}", 1),
    (r"designs\.(.*)\.bound", "no path has more, sensors: {}", 0),
    (r"designs\.(.*)\.gap", "gap of the path's proof, sensors: {}", 0),
    (r"selection\.value", "value of the schedule for the start", 1),
    (r"selection\.filter\.value", "cost of the schedule for the filter", -1),
    (r"selection\.cheapest\.value", "cost of the cheapest schedule", -1),
    (r"validation\.(.*)\.chosen\.in_band", "share of the time in the band of consistency, {}", 1),
    (r"validation\.(.*)\.chosen\.final_rmse\.(.*)", "error of {1} at the end, path: {0}", -1),
    (r"joint\.joint\.value", "value of path and schedule together", 1),
)


def headline(document: Mapping[str, Any]) -> dict[str, Scalar]:
    """Return the numbers of result.json that a table of runs has, by their keys in it.

    What the sensors see, the value of each design with its bound, the schedule of the question, and what the filter made of it.
    """
    return dict(_headline(document))


def in_words(key: str) -> str:
    """Return what a number is called."""
    for pattern, words, _ in _WORDS:
        match = re.fullmatch(pattern, key)
        if match:
            return words.format(*match.groups())
    return key


def sense(key: str) -> int:
    """Return 1 where more of a number is better, -1 where less is, 0 where neither can be said."""
    return next((better for pattern, _, better in _WORDS if re.fullmatch(pattern, key)), 0)


def _headline(document: Mapping[str, Any]) -> Iterator[tuple[str, Scalar]]:
    for manoeuvre, verdicts in document["analyses"].items():
        widest = max(verdicts, key=lambda sensors: sensors.count("+"))
        yield f"analyses.{manoeuvre}.{widest}.dimension", verdicts[widest]["dimension"]
    for suite, design in document["designs"].items():
        yield from _of(design, f"designs.{suite}", ("status", "value", "bound", "gap"))
    selection = document["selection"]
    yield from _of(selection, "selection", ("status", "value", "bound", "gap"))
    for part in ("filter", "cheapest"):
        yield from _of(selection[part] or {}, f"selection.{part}", ("value", "bound", "gap"))
    for path, checks in document["validation"].items():
        yield from _of(checks.get("chosen", {}), f"validation.{path}.chosen", ("verdict", "in_band"))
        yield from _of(checks.get("chosen", {}).get("final_rmse", {}), f"validation.{path}.chosen.final_rmse")
    if document["joint"] is not None:
        yield "joint.joint.value", document["joint"]["joint"]["value"]


def _of(part: Mapping[str, Any], where: str, keys: tuple[str, ...] | None = None) -> Iterator[tuple[str, Scalar]]:
    """Yield the entries of one part of a result under their whole keys; None = all of them."""
    return ((f"{where}.{key}", part[key]) for key in (part if keys is None else keys) if key in part)
