"""Two results beside each other: what changed in the question, and in the answers."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from obsdesign.report.document import Result, SelectionPart
from obsdesign.report.number_format import numeral
from obsdesign.report.table import Table, TableColumn, Tone, Toned, tabulate

_GOOD = "more is better for values, shares and dimensions, less for costs and errors"
_SAME = 1e-9  # relative difference of two numbers that are called the same
_SCALES = ("prior", "design.criterion", "design.about", "design.posterior_criterion", "selection.criterion", "selection.over")
Better = Literal["larger", "smaller", ""]
_Numbered = tuple[float | None, Better]


@dataclass(frozen=True)
class Change:
    """A key of the question, and its value in each of two scenarios; None = not given."""

    key: str
    first: Any
    second: Any


@dataclass(frozen=True)
class NumberPair:
    """A number of the answer in each of two results; None = there is none."""

    what: str
    first: float | None
    second: float | None
    better: Better = ""

    @property
    def ratio(self) -> float:
        """Second over first; nan where there is none."""
        if self.first is None or self.second is None or self.first == 0:
            return math.nan
        return self.second / self.first

    @property
    def is_gain(self) -> bool | None:
        """Whether the second is better; None where they are the same, or neither is."""
        if self.first is None or self.second is None or not self.better:
            return None
        if math.isclose(self.first, self.second, rel_tol=_SAME):
            return None
        return (self.second > self.first) == (self.better == "larger")


@dataclass(frozen=True)
class Comparison:
    """What changed between two results: keys of the question, numbers of the answers, and what is to be said about them."""

    changes: tuple[Change, ...]
    numbers: tuple[NumberPair, ...]
    notes: tuple[str, ...]

    def document(self) -> dict[str, Any]:
        """Return the same as JSON."""
        return {
            "changes": [{"key": change.key, "first": change.first, "second": change.second} for change in self.changes],
            "numbers": [
                {"what": pair.what, "first": pair.first, "second": pair.second, "better": pair.better or None} for pair in self.numbers
            ],
            "notes": list(self.notes),
        }


def compare_results(first: Result, second: Result) -> Comparison:
    """Return what changed from one result to another."""
    before, after = (dict(_flat(_question(result))) for result in (first, second))
    keys = [key for key in {**before, **after} if before.get(key) != after.get(key)]
    changes = tuple(Change(key, before.get(key), after.get(key)) for key in keys)
    return Comparison(changes, tuple(_pairs(dict(_numbers(first)), dict(_numbers(second)))), tuple(_notes(first, second, changes)))


def _pairs(first: Mapping[str, _Numbered], second: Mapping[str, _Numbered]) -> Iterator[NumberPair]:
    for what in dict.fromkeys([*first, *second]):
        before, after = first.get(what, (None, "")), second.get(what, (None, ""))
        yield NumberPair(what, before[0], after[0], before[1] or after[1])


def changes_table(comparison: Comparison, names: tuple[str, str]) -> Table:
    """Return what changed in the question as a table."""
    rows = [(change.key, _json_text(change.first), _json_text(change.second)) for change in comparison.changes]
    return tabulate("Keys", "", tuple(map(TableColumn, ("key", *names))), rows)


def numbers_table(comparison: Comparison, names: tuple[str, str]) -> Table:
    """Return the numbers of both answers as a table."""
    tones: dict[bool | None, Tone] = {True: "good", False: "bad", None: ""}
    rows = [
        (
            pair.what,
            math.nan if pair.first is None else pair.first,
            Toned(math.nan if pair.second is None else pair.second, tones[pair.is_gain]),
            pair.ratio,
        )
        for pair in comparison.numbers
    ]
    columns = ("", *names, "ratio")
    return tabulate("Numbers", _GOOD, tuple(TableColumn(head, _number) for head in columns), rows)


def _number(value: float) -> str:
    return "–" if math.isnan(value) else numeral(value, 4)


def _json_text(value: object) -> str:
    return "–" if value is None else json.dumps(value, ensure_ascii=False, default=str)


def _question(result: Result) -> dict[str, Any]:
    """The scenario as it was written, known truths aside, and the seed."""
    data = tomllib.loads(result.scenario.source)
    return {key: value for key, value in data.items() if key not in ("expected", "version")} | {"seed": result.seed}


def _flat(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:  # noqa: ANN401
    """Yield every value of TOML data under its path; lists of tables by number."""
    if isinstance(value, Mapping):
        for part, item in value.items():
            yield from _flat(item, f"{key}.{part}" if key else part)
    elif isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
        for number, item in enumerate(value):
            yield from _flat(item, f"{key}[{number}]")
    else:
        yield key, value


def _numbers(result: Result) -> Iterator[tuple[str, _Numbered]]:
    for manoeuvre, seen in result.analyses.items():
        everything = seen.get("+".join(result.scenario.sensors))
        if everything is not None:
            yield f"dimensions seen, {manoeuvre}", (float(everything.dimension), "larger")
    for suite, design in result.designs.items():
        yield f"value, path for {suite}", (design.value, "larger")
    for path, selection in result.selections.items():
        yield from _schedule_numbers(f", {path}" if len(result.selections) > 1 else "", selection)
    units = dict(zip(result.scenario.states, result.scenario.state_units, strict=True))
    for path, checks in result.validation.items():
        if (check := checks.get("chosen")) is not None:
            for state, error in check.final_rmse.items():
                yield f"error of {state} [{units[state]}], {path}", (error, "smaller")
            yield f"share of NEES in its band, {path}", (check.in_band, "larger")


def _schedule_numbers(path: str, selection: SelectionPart) -> Iterator[tuple[str, _Numbered]]:
    if selection.cheapest is not None:
        yield f"cost, cheapest schedule{path}", (selection.cheapest.value, "smaller")
        yield f"gap, cheapest schedule{path}", (selection.cheapest.gap, "")
    if selection.filter is not None:
        yield f"cost, schedule for the filter{path}", (selection.filter.value, "smaller")
        yield f"gap, schedule for the filter{path}", (selection.filter.gap, "")
    yield f"value, schedule for the start{path}", (selection.value, "larger")
    yield f"gap, schedule for the start{path}", (selection.gap, "")
    for sensor, seconds in selection.seconds.items():
        yield f"{sensor} on [s]{path}", (seconds, "")


def _notes(first: Result, second: Result, changes: tuple[Change, ...]) -> Iterator[str]:
    rescaled = [change.key for change in changes if change.key.startswith(_SCALES)]
    if rescaled:
        yield f"values and costs of the two are in different units, as {', '.join(rescaled)} changed; errors of the filter can be compared"
    different = {name for name in {**first.versions, **second.versions} if first.versions.get(name) != second.versions.get(name)}
    if different:
        pairs = ", ".join(f"{name} {first.versions.get(name)} and {second.versions.get(name)}" for name in sorted(different))
        yield f"made with different versions: {pairs}"
    if not changes and not different:
        yield "the question, the seed and the versions are the same"
