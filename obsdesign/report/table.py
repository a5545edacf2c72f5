"""The tables of page and terminal: columns that know how their numbers are written, and what is good in a table."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from obsdesign.report.number_format import MINUS, NARROW, NOTHING, display_unit, numeral, plain, signal_label
from obsdesign.signals import Signal

Tone = Literal["", "good", "bad"]


@dataclass(frozen=True)
class Cell:
    """One cell: its text, and whether it is good or bad news."""

    text: str
    tone: Tone = ""


@dataclass(frozen=True)
class TableColumn:
    """A column: what stands above it, with its unit, and how its numbers are written."""

    head: str
    show: Callable[[float], str] = numeral


@dataclass(frozen=True)
class Toned:
    """An entry that is good or bad news."""

    value: str | float
    tone: Tone


Entry = str | float | Toned


@dataclass(frozen=True)
class Table:
    """title; good: what is good in it; columns; rows: the first cell of each names the row."""

    title: str
    good: str
    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = ()

    @property
    def head(self) -> tuple[str, ...]:
        """One text per column, with units."""
        return tuple(column.head for column in self.columns)

    def is_words(self, column: int) -> bool:
        """Whether a column holds words, to be set flush left: no cell of it begins with a number."""
        return not any(row[column].text[:2].strip(MINUS + "≥" + NARROW)[:1].isdigit() for row in self.rows)


def tabulate(title: str, good: str, columns: Sequence[TableColumn], rows: Iterable[Sequence[Entry]], notes: Sequence[str] = ()) -> Table:
    """Return the table of entries: words as they are, numbers as their column writes them."""
    cells = (tuple(_cell(column, entry) for column, entry in zip(columns, row, strict=True)) for row in rows)
    return Table(title, good, tuple(columns), tuple(cells), tuple(notes))


def signal_column(signal: Signal) -> TableColumn:
    """Return the column of a signal, in the unit people read it in."""
    factor, _ = display_unit(signal)
    return TableColumn(signal_label(signal), lambda value: numeral(value * factor))


def deviation(value: float) -> Entry:
    """Return a standard deviation, or that there is none: hidden."""
    return Toned("hidden", "bad") if math.isinf(value) else value


def hundredths(share: float) -> str:
    """Write a share in per cent, a dash for none."""
    return NOTHING if math.isnan(share) else numeral(100 * share)


def whole_hundredths(share: float) -> str:
    """Write a share in whole per cent, a dash for none."""
    return NOTHING if math.isnan(share) else plain(round(100 * share))


def finite(value: float) -> str:
    """Write a number, a dash for none and for an infinite one."""
    return numeral(value) if math.isfinite(value) else NOTHING


def seconds(value: float) -> str:
    """Write a sum of durations that someone chose."""
    return plain(round(value, 9))


def _cell(column: TableColumn, entry: Entry) -> Cell:
    value, tone = (entry.value, entry.tone) if isinstance(entry, Toned) else (entry, "")
    return Cell(value if isinstance(value, str) else column.show(float(value)), tone)
