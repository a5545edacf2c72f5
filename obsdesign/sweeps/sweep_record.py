"""What a sweep found: a table of its runs."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from obsdesign.checks import require_known
from obsdesign.display import AbstractDisplay, Summary, data_frame
from obsdesign.sweeps.headline import Scalar

if TYPE_CHECKING:
    from pandas import DataFrame


_FEW = 6  # values that are shown one by one


@dataclass(frozen=True, eq=False)
class SweepRun:
    """One run of a sweep."""

    name: str
    """Of its file: the sha256 of all that the answer depends on, its first half."""
    varied: Mapping[str, Any]
    """Values of the keys that were varied."""
    numbers: Mapping[str, Scalar]
    """What came out, by keys of result.json; none where it failed."""
    error: str = ""
    """What it ended with, "" = well."""


@dataclass(frozen=True, eq=False)
class Sweep(AbstractDisplay):
    """Many studies of one scenario, in the order of the combinations of the keys that were varied, the last key fastest."""

    title: str
    """Of the scenario."""
    keys: tuple[str, ...]
    """What was varied."""
    runs: tuple[SweepRun, ...]
    """Every combination, those that failed included."""
    folder: Path | None = None
    """Where each run has its file, None = nowhere."""

    @property
    def failures(self) -> tuple[SweepRun, ...]:
        """The runs that ended with an error."""
        return tuple(run for run in self.runs if run.error)

    @property
    def numbers(self) -> tuple[str, ...]:
        """Keys of the numbers that any run has."""
        return tuple(dict.fromkeys(key for run in self.runs for key in run.numbers))

    def column(self, key: str) -> np.ndarray:
        """Return what each run has under a key that was varied, or a key of its numbers (runs,); nan or None where it has nothing.

        Raises InputError for another key.
        """
        require_known("a sweep's column", [key], (*self.keys, *self.numbers, "error"))
        entries = [_entry(run, key) for run in self.runs]
        if all(entry is None or (isinstance(entry, int | float) and not isinstance(entry, bool)) for entry in entries):
            return np.array([np.nan if entry is None else float(entry) for entry in entries])
        column = np.empty(len(entries), dtype=object)
        column[:] = entries
        return column

    def to_dataframe(self) -> DataFrame:
        """Return a row for each run: what was varied, its numbers, its error; needs pandas."""
        columns = {key: self.column(key) for key in (*self.keys, *self.numbers, "error")}
        return data_frame(columns, {"run": np.array([run.name for run in self.runs])})

    def to_csv(self) -> str:
        """Return the same table as CSV; what is no number, no text and no truth value is written as Python would."""
        head = (*self.keys, *self.numbers, "error")
        rows = ([run.name, *(_cell(_entry(run, key)) for key in head)] for run in self.runs)
        return "".join(map(_line, (["run", *head], *rows)))

    def _summary(self) -> Summary:
        varied = [(key, _span([run.varied[key] for run in self.runs])) for key in self.keys]
        failed = self.failures
        rows = [*varied, ("failed", f"{len(failed)}" + (f", the first: {failed[0].error}" if failed else ""))]
        return Summary(f"sweep of {len(self.runs)} runs: {self.title}", tuple(rows))


def _entry(run: SweepRun, key: str) -> Any:  # noqa: ANN401  # whatever was varied
    return run.error if key == "error" else run.varied.get(key, run.numbers.get(key))


def _line(cells: Sequence[Any]) -> str:
    """Return one line of CSV, texts with any end of a line in quotes: those of the line's own end alone would be quoted."""
    line = io.StringIO(newline="")
    csv.writer(line, lineterminator="\r\n").writerow(cells)
    return line.getvalue().removesuffix("\r\n") + "\n"


def _cell(entry: Any) -> Any:  # noqa: ANN401
    return "" if entry is None else entry if isinstance(entry, str | int | float) else repr(entry)


def _span(values: Sequence[Any]) -> str:
    """Return the different values in words: all of a few, else how many and between which."""
    different = list(dict.fromkeys(map(str, values)))
    if len(different) <= _FEW:
        return ", ".join(different)
    is_numeric = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    return f"{len(different)} values" + (f" from {min(values):g} to {max(values):g}" if is_numeric else "")
