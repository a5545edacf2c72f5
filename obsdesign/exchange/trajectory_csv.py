"""A path as a table: time, states, inputs, with units in the header."""

from __future__ import annotations

import csv
import difflib
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from obsdesign.dynamics.model import AbstractSystem
from obsdesign.errors import InputError
from obsdesign.exchange._input_recovery import recover_inputs
from obsdesign.signals import RADIANS_PER_DEGREE, Signal
from obsdesign.trajectory import Trajectory

TIME = Signal("t", "s")
_STEP_TOLERANCE = 1e-6  # how much of a step the times may be off
_MISMATCH_TOLERANCE = 1e-6  # how much of a state's range a step may miss before it is told


def trajectory_csv(system: AbstractSystem, path: Trajectory) -> str:
    """Return one row per node at full precision; the inputs of a row hold until the next one, so the last row has none.

    Unknown inputs stand last, if the path tells them.
    """
    model = system.model
    signals = (*model.states, *model.inputs, *(() if path.w is None else model.unknown_inputs))
    held = path.u if path.w is None else np.hstack([path.u, path.w])
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["t [s]", *(f"{signal.name} [{signal.unit or '-'}]" for signal in signals)])
    for t, x, inputs in zip(path.t.tolist(), path.x.tolist(), [*held.tolist(), [""] * held.shape[1]], strict=True):
        writer.writerow([t, *x, *inputs])
    return table.getvalue()


@dataclass(frozen=True, eq=False)
class ReadPath:
    """A path from a file, and what is to be said about it."""

    path: Trajectory
    notes: tuple[str, ...] = ()


def read_trajectory_csv(system: AbstractSystem, file: str | Path) -> ReadPath:
    """Read a path of a system: a header of names, with units or without, then a row per node.

    Columns in any order: t, every state, and all inputs or none. Where there are none they are found from the states. Angles may be
    in [deg], and need not be continuous. Raises InputError, naming file, line and column, for what cannot be read: columns that are
    missing, unknown or twice, values that are not finite, times that do not increase by equal steps.
    """
    file = Path(file)
    lines = _lines(file)
    columns = _columns(system, file, lines[0][1])
    held = {signal.name for signal in (*system.model.inputs, *system.model.unknown_inputs)}
    values = {column.signal.name: _values(file, lines[1:], column, column.signal.name in held) for column in columns}
    t = np.array(values[TIME.name])
    _require_even(file, lines[1:], t)
    states = [np.unwrap(values[state.name]) if state.is_angle else np.array(values[state.name]) for state in system.model.states]
    return _path(system, file, t, np.column_stack(states), {name: values[name] for name in values if name in held})


@dataclass(frozen=True)
class _Column:
    """Where a signal stands in a row, how it is written, and what its numbers are multiplied by."""

    signal: Signal
    index: int
    header: str
    factor: float


def _lines(file: Path) -> list[tuple[int, list[str]]]:
    """Return the rows that are not empty with their line numbers."""
    try:
        with file.open(newline="", encoding="utf-8-sig") as table:
            reader = csv.reader(table)
            lines = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(cell.strip() for cell in row)]
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{file}: is no table of text: {error}") from None
    if len(lines) < 3:
        raise InputError(f"{file}: has {max(len(lines) - 1, 0)} rows below its header: a path needs at least two")
    for line, row in lines[1:]:
        if len(row) != len(lines[0][1]):
            raise InputError(f"{file}, line {line}: has {len(row)} columns: the header has {len(lines[0][1])}")
    return lines


def _columns(system: AbstractSystem, file: Path, header: Sequence[str]) -> list[_Column]:
    model = system.model
    signals = {signal.name: signal for signal in (TIME, *model.states, *model.inputs, *model.unknown_inputs)}
    accepted = ", ".join(signals)
    columns: list[_Column] = []
    for index, written in enumerate(header):
        name, _, unit = written.partition("[")
        name = name.strip()
        if name not in signals:
            near = difflib.get_close_matches(name, signals, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise InputError(f"{file}, line 1, column {index + 1}: unknown name {name!r}{hint} (accepted: {accepted})")
        if name in [column.signal.name for column in columns]:
            raise InputError(f"{file}, line 1, column {index + 1}: {name!r} is there twice")
        columns.append(_Column(signals[name], index, name, _factor(file, index, signals[name], unit.strip().rstrip("]").strip())))
    present = {column.signal.name for column in columns}
    missing = [signal.name for signal in (TIME, *model.states) if signal.name not in present]
    for group in (model.inputs, model.unknown_inputs):
        given = [signal.name for signal in group if signal.name in present]
        missing += [signal.name for signal in group if given and signal.name not in present]
    if missing:
        raise InputError(f"{file}, line 1: no column {missing[0]!r} (a path needs {', '.join(s.name for s in (TIME, *model.states))})")
    return columns


def _factor(file: Path, index: int, signal: Signal, unit: str) -> float:
    if unit in ("", signal.unit) or (unit == "-" and not signal.unit):
        return 1.0
    if unit == signal.unit.replace("rad", "deg"):
        return RADIANS_PER_DEGREE
    degrees = f" or {signal.unit.replace('rad', 'deg')}" if "rad" in signal.unit else ""
    raise InputError(f"{file}, line 1, column {index + 1}: {signal.name} is in {unit!r}: must be in {signal.unit or 'no unit'}{degrees}")


def _values(file: Path, lines: list[tuple[int, list[str]]], column: _Column, held: bool) -> list[float]:
    """The numbers of a column; the inputs of the last row hold for nothing and may be left out."""
    rows = lines[:-1] if held else lines
    numbers = []
    for line, row in rows:
        try:
            number = float(row[column.index])
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise InputError(f"{file}, line {line}, column {column.header!r}: {row[column.index]!r} is no finite number")
        numbers.append(number * column.factor)
    return numbers


def _require_even(file: Path, lines: list[tuple[int, list[str]]], t: np.ndarray) -> None:
    steps = np.diff(t)
    if (steps <= 0).any():
        k = int(np.argmax(steps <= 0)) + 1
        raise InputError(f"{file}, line {lines[k][0]}, column 't': {t[k]:g} s comes after {t[k - 1]:g} s: times must increase")
    step = (t[-1] - t[0]) / len(steps)
    off = np.abs(steps - steps[0]) > _STEP_TOLERANCE * step
    if off.any():
        k = int(np.argmax(off)) + 1
        raise InputError(
            f"{file}, line {lines[k][0]}, column 't': a step of {steps[k - 1]:g} s after steps of {steps[0]:g} s: must be equal"
        )


def _path(system: AbstractSystem, file: Path, t: np.ndarray, x: np.ndarray, held: dict[str, list[float]]) -> ReadPath:
    model = system.model
    inputs, unknown = (
        np.column_stack([held[name] for name in names]) if names and names[0] in held else None
        for names in (model.input_names, tuple(signal.name for signal in model.unknown_inputs))
    )
    if inputs is not None or not model.input_names:
        return ReadPath(Trajectory(t, x, np.empty((len(t) - 1, 0)) if inputs is None else inputs, unknown))
    path = Trajectory(t, x, np.zeros((len(t) - 1, len(model.inputs))))
    recovered = recover_inputs(system, x, path.step)
    notes = [f"{file.name} has no inputs: they are those that lead from each of its states to the next."]
    mismatch, reach = np.abs(recovered.mismatch), np.maximum(np.ptp(x, axis=0), 1e-3)
    k, i = np.unravel_index(int(np.argmax(mismatch / reach)), mismatch.shape)
    if mismatch[k, i] > _MISMATCH_TOLERANCE * reach[i]:
        by = f"{model.states[i].name} by {mismatch[k, i]:.3g} {model.states[i].unit}"
        notes.append(f"No inputs of the vehicle lead through all of its states: at {t[k]:g} s a step misses {by}.")
    return ReadPath(Trajectory(t, x, recovered.u, unknown), tuple(notes))
