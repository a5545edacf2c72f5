"""Logs as tables of text: one value a row (long), or a column for each signal (wide)."""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.errors import InputError
from obsdesign.logs.recording import Recording, Topic
from obsdesign.logs.series import TRUTH, FileContents, Series
from obsdesign.logs.times import Times, times_of_text
from obsdesign.logs.units import factor_of, name_and_unit
from obsdesign.signals import Signal

_TIME_NAMES = ("t", "time", "timestamp")
_INCREMENT = "delta."  # what the names of inputs that came together since the row before begin with


@dataclass(frozen=True, eq=False)
class _Table:
    """Header and rows of a file, with the line of each row."""

    file: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, without units."""
        return tuple(name_and_unit(word)[0] for word in self.header)

    def column(self, name: str) -> int:
        """Where a column stands; -1 for none."""
        return self.names.index(name) if name in self.names else -1

    def number(self, row: int, column: int) -> float:
        """The number of a cell, nan for an empty one."""
        word = self.rows[row][column]
        if not word:
            return math.nan
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            where = f"{self.file}, line {self.lines[row]}, column {self.header[column]!r}"
            advice = "write it with a point" if "," in word else "leave the cell empty where there is no value"
            raise InputError(f"{where}: {word!r} is no finite number: {advice}")
        return value


def read_csv_log(file: Path, model: Model) -> FileContents:
    """Read a table: t and either `signal`, `value` and perhaps `sigma`, or a column for each signal, with units in the header.

    Signals are inputs (`delta.speed` for what came together since the row before), sensors or their outputs, and `truth.` with a state.
    Raises InputError, naming file, line and column.
    """
    table = _read(file)
    time_column = _time_column(table)
    unit = name_and_unit(table.header[time_column])[1] or _suffix_unit(table.names[time_column])
    where = f"{file}, column {table.header[time_column]!r}"
    times = times_of_text(where, [row[time_column] for row in table.rows], table.lines, unit)
    is_long = table.column("signal") >= 0 and table.column("value") >= 0
    series = _long(table, model, times) if is_long else _wide(table, model, times, time_column)
    return FileContents(file, tuple(series), times.epoch, (times.note,) if times.note else ())


def read_csv_recording(file: Path) -> Recording:
    """Return the columns of a table, and of a long one those of each signal as a topic; cells that are no numbers are nan."""
    table = _read(file)
    time_column = _time_column(table)
    unit = name_and_unit(table.header[time_column])[1] or _suffix_unit(table.names[time_column])
    times = times_of_text(f"{file}, column {table.header[time_column]!r}", [row[time_column] for row in table.rows], table.lines, unit)
    signal = table.column("signal")
    groups = {"table": np.arange(len(table.rows))}
    if signal >= 0:
        words = np.array([row[signal] for row in table.rows])
        groups = {str(word): np.flatnonzero(words == word) for word in dict.fromkeys(words.tolist())}
    columns = [column for column in range(len(table.header)) if column not in (time_column, signal)]
    lines = np.array(table.lines)
    topics = {
        name: Topic(
            name,
            times.t[rows],
            {table.names[c]: np.array([_number_or_nan(table.rows[row][c]) for row in rows]) for c in columns},
            lines[rows],
        )
        for name, rows in groups.items()
    }
    return Recording(file, "table", topics, times.epoch, "line", (times.note,) if times.note else ())


def _number_or_nan(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan


def _suffix_unit(name: str) -> str:
    """The unit of a name such as t_s."""
    return name.rpartition("_")[2] if name.rpartition("_")[2] in ("s", "ms", "us", "ns") else ""


def _time_column(table: _Table) -> int:
    names = [name for name in table.names if name in _TIME_NAMES or (name.rpartition("_")[0] in _TIME_NAMES and _suffix_unit(name))]
    if not names:
        raise InputError(f"{table.file}, line 1: no column 't' (columns are {', '.join(table.header)}): a log needs times")
    return table.column(names[0])


def _read(file: Path) -> _Table:
    try:
        with file.open(newline="", encoding="utf-8-sig") as text:
            lines = _rows(text)
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{file}: is no table of text: {error}") from None
    if len(lines) < 2:
        raise InputError(f"{file}: has no rows below its header: a log needs some")
    header = lines[0][1]
    for line, row in lines[1:]:
        if len(row) != len(header):
            raise InputError(f"{file}, line {line}: has {len(row)} columns: the header has {len(header)}")
    return _Table(file, header, tuple(row for _, row in lines[1:]), tuple(line for line, _ in lines[1:]))


def _rows(text: TextIO) -> list[tuple[int, tuple[str, ...]]]:
    """Return line and cells of all rows but empty ones and remarks (#) above the header, which says by what cells are parted."""
    remarks = 0
    while (first := text.readline()).startswith("#") or (first and not first.strip()):
        remarks += 1
    parting = "," if "," in first else next((mark for mark in ";\t" if mark in first), ",")
    reader = csv.reader(itertools.chain([first], text), delimiter=parting)
    rows = ((remarks + reader.line_num, tuple(cell.strip() for cell in row)) for row in reader)
    return [(line, cells) for line, cells in rows if any(cells)]


def _wide(table: _Table, model: Model, times: Times, time_column: int) -> list[Series]:
    if table.column("signal") >= 0:
        columns = ", ".join(table.header)
        raise InputError(f"{table.file}, line 1: has a column 'signal' and no column 'value' beside it (columns are {columns})")
    backwards = np.flatnonzero(np.diff(times.t) < 0)
    if len(backwards):
        row = int(backwards[0]) + 1
        raise InputError(
            f"{table.file}, line {table.lines[row]}, column {table.header[time_column]!r}: {times.t[row]:.9g} s comes after"
            f" {times.t[row - 1]:.9g} s: times must not go backwards"
        )
    return [_wide_column(table, model, times, column) for column in range(len(table.header)) if column != time_column]


def _wide_column(table: _Table, model: Model, times: Times, column: int) -> Series:
    name, unit = name_and_unit(table.header[column])
    where = f"{table.file}, line 1, column {table.header[column]!r}"
    if table.names.count(name) > 1:
        raise InputError(f"{where}: {name!r} is there twice")
    values = np.array([table.number(row, column) for row in range(len(table.rows))])
    present = np.flatnonzero(np.isfinite(values))
    factor = _factor(where, model, name, unit)
    is_increment = name.startswith(_INCREMENT)
    return Series(
        name.removeprefix(_INCREMENT), times.t[present], factor * values[present, None], table.header[column],
        np.array(table.lines)[present], is_increment=is_increment,
    )  # fmt: skip


def _long(table: _Table, model: Model, times: Times) -> list[Series]:
    signal, value, sigma, unit = (table.column(name) for name in ("signal", "value", "sigma", "unit"))
    rows_of: dict[str, list[int]] = {}
    for row, cells in enumerate(table.rows):
        rows_of.setdefault(cells[signal], []).append(row)
    return [_long_signal(table, model, times, name, rows, (value, sigma, unit)) for name, rows in rows_of.items()]


def _long_signal(table: _Table, model: Model, times: Times, written: str, rows: Sequence[int], columns: tuple[int, int, int]) -> Series:
    value, sigma, unit_column = columns
    name, unit = name_and_unit(written)
    first = f"{table.file}, line {table.lines[rows[0]]}, column 'signal'"
    unit = unit or (table.rows[rows[0]][unit_column] if unit_column >= 0 else "")
    factor = _factor(first, model, name, unit)
    values = np.array([table.number(row, value) for row in rows])
    empty = np.flatnonzero(np.isnan(values))
    if len(empty):
        line = table.lines[rows[int(empty[0])]]
        raise InputError(f"{table.file}, line {line}, column {table.header[value]!r}: is empty: a row of {name!r} needs a value")
    sigmas = None if sigma < 0 else factor * np.array([table.number(row, sigma) for row in rows])
    if sigmas is not None and (wrong := np.flatnonzero(sigmas <= 0)).size:
        line = table.lines[rows[int(wrong[0])]]
        raise InputError(f"{table.file}, line {line}, column {table.header[sigma]!r}: {sigmas[wrong[0]]:g} must be above 0")
    return Series(
        name.removeprefix(_INCREMENT), times.t[list(rows)], factor * values[:, None], name, np.array(table.lines)[list(rows)],
        sigma=sigmas, is_increment=name.startswith(_INCREMENT),
    )  # fmt: skip


def _factor(where: str, model: Model, name: str, unit: str) -> float:
    """Return the factor of a signal of this system; 1 for an unknown name, which is refused later with all that is accepted."""
    if name.startswith(_INCREMENT):
        signal = signals_of(model).get(name.removeprefix(_INCREMENT))
        # an integral of m/s is in m
        return 1.0 if signal is None else factor_of(where, Signal(name, signal.unit.removesuffix("/s"), signal.is_angle), unit)
    signal = signals_of(model).get(name)
    return 1.0 if signal is None else factor_of(where, signal, unit)


def signals_of(model: Model) -> dict[str, Signal]:
    """Return what each name of a log means: inputs, outputs, sensors of one output, and `truth.` with a state."""
    signals = {signal.name: signal for signal in (*model.inputs, *model.outputs)}
    signals |= {name: model.outputs[places[0]] for name, places in model.outputs_of.items()}
    return signals | {TRUTH + signal.name: signal for signal in model.states}
