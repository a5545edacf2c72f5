"""What else is known of the states of a recorded run, for judging alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.calculus import wrap_columns
from obsdesign.logs.inputs import as_history, distinct_names


@validate_arguments
@dataclass(frozen=True, eq=False)
class LogTruth:
    """True values of some states at some times.

    Raises InputError for shapes that do not fit, names twice, times that are not finite or do not increase, and values that are infinite.
    """

    names: tuple[str, ...]
    """Names of the r states."""
    t: np.ndarray
    """Times (L,) [s], increasing."""
    x: np.ndarray
    """Values (L, r) in the units of the states, nan where one is not known."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", distinct_names("truth", self.names))
        for name, value in zip("tx", as_history("truth", self.names, "tx", (self.t, self.x)), strict=True):
            object.__setattr__(self, name, value)

    def at(self, times: np.ndarray, angles: tuple[str, ...] = (), max_gap: float = np.inf) -> np.ndarray:
        """Return the states (N, r) at times (N,) [s], linear between values, nan before the first, after the last and in gaps.

        Arguments:
            times (N,): where they are asked for [s].
            angles: states that wrap; returned without jumps.
            max_gap: longest time between two values between which it is said [s].
        """
        return np.column_stack([self._column(i, times, name in angles, max_gap) for i, name in enumerate(self.names)])

    def stretch(self, first: float, last: float) -> LogTruth:
        """Return the values from one time to another [s]."""
        inside = (self.t >= first) & (self.t <= last)
        return LogTruth(self.names, self.t[inside], self.x[inside])

    def _column(self, column: int, times: np.ndarray, is_angle: bool, max_gap: float) -> np.ndarray:
        is_known = np.isfinite(self.x[:, column])
        t, values = self.t[is_known], self.x[is_known, column]
        if not len(t):
            return np.full(len(times), np.nan)
        values = np.unwrap(values) if is_angle else values
        result = np.interp(times, t, values, left=np.nan, right=np.nan)
        place = np.clip(np.searchsorted(t, times, side="left"), 1, max(len(t) - 1, 1))
        if len(t) > 1:
            is_gap = (t[place] - t[place - 1] > max_gap) & (times != t[place]) & (times != t[place - 1])
            result[is_gap] = np.nan
        return result


def errors_against(
    truth: LogTruth, state_names: tuple[str, ...], angles: tuple[str, ...], t: np.ndarray, x: np.ndarray, max_gap: float = np.inf
) -> np.ndarray:
    """Return estimate minus truth (N, n) of states x (N, n) at times t (N,), angles wrapped, nan where the truth says nothing.

    That is also between values farther apart than max_gap [s].
    """
    errors = np.full(x.shape, np.nan)
    values = truth.at(t, angles, max_gap)
    for column, name in enumerate(truth.names):
        if name in state_names:
            i = state_names.index(name)
            errors[:, i] = x[:, i] - values[:, column]
    return wrap_columns(errors, np.array([name in angles for name in state_names]))
