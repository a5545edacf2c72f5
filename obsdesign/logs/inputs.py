"""Known inputs as they were recorded: each column held from one reading to the next, or added up between them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array, require_known
from obsdesign.errors import InputError


@validate_arguments
@dataclass(frozen=True, eq=False)
class LogInputs:
    """Readings of the known inputs of a system.

    Raises InputError for shapes that do not fit, names twice, times that are not finite or do not increase, and values that are infinite.
    """

    names: tuple[str, ...]
    """Names of the m columns, inputs of a system."""
    t: np.ndarray
    """Times (M,) [s] of the readings, increasing."""
    u: np.ndarray
    """Readings (M, m) in the units of the inputs, nan where a column has none at that time. A reading is held until the next one."""
    increments: tuple[str, ...] = ()
    """Columns that hold integrals instead: what came together since the reading before, such as a distance for a speed."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", distinct_names("inputs", self.names))
        object.__setattr__(self, "increments", distinct_names("increments", self.increments))
        require_known("log: increments: inputs", self.increments, self.names)
        for name, value in zip("tu", as_history("inputs", self.names, "tu", (self.t, self.u)), strict=True):
            object.__setattr__(self, name, value)

    def over(self, times: np.ndarray) -> np.ndarray:
        """Return the mean (N, m) of each input over each of the N steps between times (N+1,) [s], which increase.

        Of what is held the integral over the step by its length, of what is added up the share of each increment that falls into it.
        Before the first reading of a column that reading is held, after the last one the last; before the first and after the last
        increment the mean rate of that one goes on.
        """
        return self.integrals(times) / np.diff(times)[:, None]

    def integrals(self, times: np.ndarray) -> np.ndarray:
        """Return the integral (N, m) of each input over each of the N steps between times (N+1,) [s], as `over` has it."""
        integrals = np.empty((len(times) - 1, len(self.names)))
        for i in range(len(self.names)):
            integrals[:, i] = np.diff(self._integral(i, times))
        return integrals

    def at(self, times: np.ndarray) -> np.ndarray:
        """Return each input (N, m) from each of the times (N,) [s] on: what is held then, of increments the mean rate."""
        return np.column_stack([self._rates(i, times) for i in range(len(self.names))])

    def _rates(self, column: int, times: np.ndarray) -> np.ndarray:
        nodes, sums, (before, after) = self._piecewise[column]
        rates = np.concatenate([[before], np.diff(sums) / np.diff(nodes), [after]])
        return rates[np.searchsorted(nodes, times, side="right")]

    def stretch(self, first: float, last: float) -> LogInputs:
        """Return the readings from one time to another [s], at the beginning those before that still hold there; of increments that
        part as well which came together until the end. Integrals within that time stay what they are.
        """
        start = max(int(np.searchsorted(self.t, first, side="right")) - 1, 0)
        end = max(int(np.searchsorted(self.t, last, side="right")), start + 1)
        t, u = self.t[start:end].copy(), self.u[start:end].copy()
        if len(t) and t[0] <= first:
            t[0], u[0] = first, [self._latest(i, start) for i in range(len(self.names))]
        if self.increments and len(t) and t[-1] < last:
            t, u = np.append(t, last), np.vstack([u, np.full(u.shape[1], np.nan)])
        if self.increments and len(t) > 1:
            # between all rows, as the reading before the first may be far away
            added = [self.names.index(name) for name in self.increments]
            sums = self.integrals(t)[:, added]
            u[:, added] = np.vstack([sums[:1], sums])
        return LogInputs(self.names, t, u, self.increments)

    def _latest(self, column: int, row: int) -> float:
        """The last reading of a column up to a row, nan where there is none; increments count from their own row on."""
        if self.names[column] in self.increments:
            return float(self.u[row, column])
        is_read = np.flatnonzero(np.isfinite(self.u[: row + 1, column]))
        return float(self.u[is_read[-1], column]) if len(is_read) else float("nan")

    def _integral(self, column: int, times: np.ndarray) -> np.ndarray:
        """Return the integral (N+1,) of an input up to each of the times, from an arbitrary zero."""
        nodes, sums, slopes = self._piecewise[column]
        if not len(nodes):
            raise InputError(f"log: input {self.names[column]!r} has no reading: the motion cannot be told without it")
        inner = np.interp(times, nodes, sums)
        before, after = times < nodes[0], times > nodes[-1]
        inner[before] += slopes[0] * (times[before] - nodes[0])
        inner[after] += slopes[1] * (times[after] - nodes[-1])
        return inner

    @cached_property
    def _piecewise(self) -> list[tuple[np.ndarray, np.ndarray, tuple[float, float]]]:
        """For each column the nodes (.,) and values (.,) of its integral, linear between them, and its slopes before and after."""
        return [self._nodes_of(i) for i in range(len(self.names))]

    def _nodes_of(self, column: int) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
        is_read = np.isfinite(self.u[:, column])
        nodes, values = self.t[is_read], self.u[is_read, column]
        if not len(nodes):
            return nodes, values, (0.0, 0.0)
        if self.names[column] not in self.increments:
            sums = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(nodes))])
            return nodes, sums, (float(values[0]), float(values[-1]))
        if len(nodes) == 1:
            raise InputError(f"log: increments of {self.names[column]!r} have one reading: over which time it came together is not told")
        # the first came together since a time that nobody wrote down: as long as to the second
        spans = np.diff(nodes, prepend=2 * nodes[0] - nodes[1])
        slopes = float(values[0] / spans[0]), float(values[-1] / spans[-1])
        return np.append(nodes[0] - spans[0], nodes), np.append(0.0, np.cumsum(values)), slopes


def distinct_names(what: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return names as a tuple; raise InputError for a name that stands twice and for what is no name."""
    if isinstance(names, str) or not isinstance(names, Iterable) or not all(isinstance(name, str) for name in names):
        raise InputError(f"log: names of {what} are {names!r}: must be a tuple of texts")
    result = tuple(str(name) for name in names)
    for name in result:
        if result.count(name) > 1:
            raise InputError(f"log: {what} have {name!r} twice: names must be distinct")
    return result


def as_history(what: str, names: tuple[str, ...], letters: str, given: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return times (M,) and a column for each name (M, m), nan for no value, as arrays that nobody writes to.

    letters: what the two are called. Raises InputError for shapes that do not fit, times that are not finite or do not increase, and
    infinite values.
    """
    t, values = (as_array(f"log: {what} {letter}", value) for letter, value in zip(letters, given, strict=True))
    if t.ndim != 1 or values.shape != (len(t), len(names)):
        raise InputError(f"log: {what} t {t.shape} and {letters[1]} {values.shape} do not fit: must be (M,) and (M, {len(names)})")
    _require_increasing(f"log: {what}", t)
    if np.isinf(values).any():
        row, column = (int(place) for place in np.argwhere(np.isinf(values))[0])
        where = f"log: {what} {letters[1]}[{row}, {column}] ({names[column]})"
        raise InputError(f"{where} is {values[row, column]}: must be finite, or nan for none")
    for array in (t, values):
        array.setflags(write=False)
    return t, values


def _require_increasing(what: str, t: np.ndarray) -> None:
    if not np.isfinite(t).all():
        row = int(np.argwhere(~np.isfinite(t))[0, 0])
        raise InputError(f"{what}: t[{row}] is {t[row]}: must be finite")
    backwards = np.flatnonzero(np.diff(t) <= 0)
    if len(backwards):
        row = int(backwards[0]) + 1
        raise InputError(f"{what}: t[{row}] is {t[row]:.12g} after {t[row - 1]:.12g}: times must increase")
