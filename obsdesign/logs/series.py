"""What any file holds once it is read: named series of numbers with their places in the file; and the log that they make together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from obsdesign.checks import require_known
from obsdesign.dynamics.model import Model
from obsdesign.errors import InputError
from obsdesign.logs.inputs import LogInputs
from obsdesign.logs.log import Log
from obsdesign.logs.samples import LogSamples
from obsdesign.logs.time_gaps import gap_notes
from obsdesign.logs.times import since_start
from obsdesign.logs.truth import LogTruth

_STUCK, _LARGEST = 8, 1e12  # samples that do not happen to be the same; a value in SI units, and the inverse of a standard deviation
TRUTH = "truth."  # what the names of true states begin with


@dataclass(frozen=True, eq=False)
class Series:
    """Values (K, c) of an input, a sensor, one of its outputs or a true state ("truth.x") at times t (K,) [s], in the system's units.

    column: what the file calls it; rows (K,): where the values stand in the file; row_word: what a row of the file is. sigma (K,) or None:
    standard deviations of samples; is_increment: whether values of an input came together since the ones before.
    """

    name: str
    t: np.ndarray
    values: np.ndarray
    column: str
    rows: np.ndarray
    row_word: str = "line"
    sigma: np.ndarray | None = None
    is_increment: bool = False

    def place(self, row: int) -> str:
        """Return where a value stands."""
        return f"{self.row_word} {int(self.rows[row])}, column {self.column!r}"

    def part(self, chosen: np.ndarray) -> Series:
        """Return the values that are chosen (K,), or stand at these places."""
        sigma = None if self.sigma is None else self.sigma[chosen]
        return replace(self, t=self.t[chosen], values=self.values[chosen], rows=self.rows[chosen], sigma=sigma)


@dataclass(frozen=True, eq=False)
class FileContents:
    """All series of a file, the Unix time [s] that their times count from, and what was done to them."""

    file: Path
    series: tuple[Series, ...]
    epoch: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def since_start(self) -> FileContents:
        """The same, with Unix times as seconds since the whole second before the first."""
        times = since_start(np.concatenate([part.t for part in self.series])) if self.epoch is None and self.series else None
        if times is None or times.epoch is None:
            return self
        series = tuple(replace(part, t=part.t - times.epoch) for part in self.series)
        return FileContents(self.file, series, times.epoch, (*self.notes, times.note))


def log_of(model: Model, contents: FileContents) -> Log:
    """Return the log of a file's series.

    Raises InputError, naming file, row and column, for names that are not the system's, inputs that are missing, one time with two
    values, values that are not finite, and samples of only some of a sensor's outputs.
    """
    contents = contents.since_start
    file, notes = contents.file, list(contents.notes)
    _require_names(model, contents)
    series = [_without_repeats(file, _finite(file, part), notes) for part in contents.series]
    notes.extend(gap_notes(file, [part for part in series if not part.name.startswith(TRUTH)]))
    samples = _samples(model, file, series, notes)
    inputs = _inputs(model, file, [part for name in model.input_names for part in series if part.name == name])
    truth = _truth(model, file, [part for name in model.state_names for part in series if part.name == TRUTH + name])
    for name, count in samples.counts.items():
        if not count:
            notes.append(f"{name} never answers: the file has no sample of it")
        values = samples.y[samples.sensor == samples.names.index(name)]
        if count >= _STUCK and (values[:, 0] == values[0, 0]).all():
            notes.append(f"{name}: all {count} samples are {values[0, 0]:g}: is it stuck?")
    if truth is not None and truth.t[0] > samples.t[0]:
        notes.append(f"the truth starts {truth.t[0] - samples.t[0]:.4g} s after the samples")
    return Log(inputs, samples, truth, contents.epoch, tuple(notes))


def _require_names(model: Model, contents: FileContents) -> None:
    outputs = tuple(signal.name for signal in model.outputs)
    accepted = (*model.input_names, *model.sensor_names, *outputs, *(TRUTH + name for name in model.state_names))
    for part in contents.series:
        require_known(f"{contents.file}, column {part.column!r}: the system", [part.name], tuple(dict.fromkeys(accepted)))


def _finite(file: Path, series: Series) -> Series:
    wrong = ~np.isfinite(series.values).all(axis=1) | ~np.isfinite(series.t)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"{file}, {series.place(row)}: {series.values[row].tolist()} at t = {series.t[row]:.9g} s is not finite: without a value"
            " there is no row, or an empty cell"
        )
    _require_sizes(file, series, np.abs(series.values).max(axis=1, initial=0.0), (0.0, _LARGEST))
    if series.sigma is not None:
        _require_sizes(file, series, np.where(np.isnan(series.sigma), 1.0, series.sigma), (1 / _LARGEST, _LARGEST))
    return series


def _require_sizes(file: Path, series: Series, sizes: np.ndarray, accepted: tuple[float, float]) -> None:
    """Raise InputError for a value, or a standard deviation, whose size (K,) is none that anything has in SI units."""
    wrong = (sizes < accepted[0]) | (sizes > accepted[1])
    if wrong.any():
        row = int(np.argmax(wrong))
        where, (low, high) = f"{file}, {series.place(row)}", accepted
        raise InputError(f"{where}: a size of {sizes[row]:g} at t = {series.t[row]:.9g} s: must be between {low:g} and {high:g}")


def _without_repeats(file: Path, series: Series, notes: list[str]) -> Series:
    """Sort by time, and leave out what stands there twice to the last digit."""
    ordered = series.part(np.argsort(series.t, kind="stable"))
    is_same = np.ones(len(ordered.t), dtype=bool)
    is_same[np.unique(np.column_stack([ordered.t, ordered.values]), axis=0, return_index=True)[1]] = False
    if is_same.any():
        row = int(np.argmax(is_same))
        notes.append(
            f"{file.name}: {int(is_same.sum())} values of {series.column!r} stand there twice, first {ordered.place(row)}: left out once"
        )
    return ordered.part(np.flatnonzero(~is_same))


def _single_valued(file: Path, series: Series) -> Series:
    """Raise InputError for two values at one time."""
    repeats = np.flatnonzero(np.diff(series.t) == 0)
    if len(repeats):
        row = int(repeats[0]) + 1
        raise InputError(
            f"{file}, {series.place(row)}: {series.values[row, 0]:g} at t = {series.t[row]:.9g} s, where {series.place(row - 1)} has"
            f" {series.values[row - 1, 0]:g}: a time may have one value"
        )
    return series


def _table(file: Path, series: Sequence[Series]) -> tuple[np.ndarray, np.ndarray]:
    """Return all times (M,) and a column for each series (M, m), nan where it has no value."""
    times = np.unique(np.concatenate([part.t for part in series]))
    values = np.full((len(times), len(series)), np.nan)
    for i, part in enumerate(series):
        _single_valued(file, part)
        values[np.searchsorted(times, part.t), i] = part.values[:, 0]
    return times, values


def _inputs(model: Model, file: Path, series: Sequence[Series]) -> LogInputs | None:
    missing = [name for name in model.input_names if name not in [part.name for part in series if len(part.t)]]
    if missing:
        raise InputError(f"{file}: has no input {missing[0]!r}: the vehicle moves by {', '.join(model.input_names)}")
    if single := [part for part in series if part.is_increment and len(part.t) == 1]:
        raise InputError(f"{file}, {single[0].place(0)}: the only increment: over which time it came together is not told")
    if not series:
        return None
    times, values = _table(file, series)
    return LogInputs(tuple(part.name for part in series), times, values, tuple(part.name for part in series if part.is_increment))


def _truth(model: Model, file: Path, series: Sequence[Series]) -> LogTruth | None:
    filled = [part for part in series if len(part.t)]
    if not filled:
        return None
    times, values = _table(file, filled)
    return LogTruth(tuple(part.name.removeprefix(TRUTH) for part in filled), times, values)


def _samples(model: Model, file: Path, series: Sequence[Series], notes: list[str]) -> LogSamples:
    by_sensor = {name: list(_series_of_sensor(model, file, name, series)) for name in model.sensor_names}
    q = max((len(places) for places in model.outputs_of.values()), default=1)
    t, sensor, y, sigma = [np.zeros(0)], [np.zeros(0)], [np.zeros((0, q))], [np.zeros(0)]
    for place, name in enumerate(model.sensor_names):
        for part in by_sensor[name]:
            t.append(part.t)
            sensor.append(np.full(len(part.t), place))
            y.append(np.pad(part.values, ((0, 0), (0, q - part.values.shape[1])), constant_values=np.nan))
            sigma.append(np.full(len(part.t), np.nan) if part.sigma is None else part.sigma)
    columns = [np.concatenate(parts) for parts in (t, sensor, y, sigma)]
    if not len(columns[0]):
        raise InputError(f"{file}: has no sample of any of the sensors {', '.join(model.sensor_names)}")
    if len(columns[0]) == 1:
        raise InputError(f"{file}: has one sample, at t = {columns[0][0]:.9g} s: a log needs at least two")
    return LogSamples(model.sensor_names, *columns)


def _series_of_sensor(model: Model, file: Path, name: str, series: Sequence[Series]) -> Iterable[Series]:
    """Yield the samples of a sensor: those given as a whole, and those of which every output has its own column."""
    outputs = [model.outputs[i].name for i in model.outputs_of[name]]
    for part in series:
        if part.name == name and part.values.shape[1] != len(outputs):
            raise InputError(
                f"{file}, column {part.column!r}: {name!r} has {part.values.shape[1]} values a sample, its outputs are {', '.join(outputs)}"
            )
        if part.name == name:
            yield part
    if outputs == [name]:
        return
    columns = [[part for part in series if part.name == output] for output in outputs]
    if any(columns):
        yield _join_outputs(file, name, [_only(file, output, parts) for output, parts in zip(outputs, columns, strict=True)])


def _only(file: Path, name: str, parts: Sequence[Series]) -> Series:
    if len(parts) != 1:
        raise InputError(f"{file}: output {name!r} has {len(parts)} columns: a sample needs each output of its sensor once")
    return _single_valued(file, parts[0])


def _join_outputs(file: Path, name: str, parts: Sequence[Series]) -> Series:
    """Return samples of several outputs; raise InputError for a time at which one of them is missing."""
    times = np.unique(np.concatenate([part.t for part in parts]))
    for part in parts:
        missing = times[~np.isin(times, part.t)]
        if len(missing):
            raise InputError(
                f"{file}, column {part.column!r}: has no value at t = {missing[0]:.9g} s, where other outputs of {name!r} have one"
            )
    values = np.column_stack([part.values[:, 0] for part in parts])
    return replace(parts[0], name=name, t=times, values=values, sigma=_common_sigma(file, parts))


def _common_sigma(file: Path, parts: Sequence[Series]) -> np.ndarray | None:
    """Return the standard deviation of each sample (K,), nan where no output has one; raise InputError where they differ."""
    told = [(part, part.sigma) for part in parts if part.sigma is not None]
    if not told:
        return None
    sigma = np.full(len(parts[0].t), np.nan)
    for part, own in told:
        differs = np.flatnonzero(np.isfinite(sigma) & np.isfinite(own) & (sigma != own))
        if len(differs):
            row = int(differs[0])
            raise InputError(
                f"{file}, {part.place(row)}: sigma is {own[row]:g}, where {told[0][0].place(row)} has {sigma[row]:g}: outputs of one sensor"
                " have one"
            )
        sigma = np.where(np.isfinite(sigma), sigma, own)
    return sigma
