"""A path: times, states and inputs; the same record from simulation, design and log files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import all_finite, as_array, require_count, require_positive, require_tolerance
from obsdesign.display import AbstractDisplay, Summary, data_frame, number, state_picture
from obsdesign.errors import InputError

if TYPE_CHECKING:
    from pandas import DataFrame

TOLERANCE = 1e-6  # relative error that steps may have where nobody says another


@validate_arguments
@dataclass(frozen=True, eq=False)
class Trajectory(AbstractDisplay):
    """A path of N steps, inputs being held over each: equal ones of a simulation or a design, of any length from a log.

    Raises InputError for shapes that do not fit, values that are not finite and times that do not increase.
    """

    t: np.ndarray
    """Instants (N+1,) [s], increasing."""
    x: np.ndarray
    """States (N+1, n) at these instants, in the units of the states."""
    u: np.ndarray
    """Known inputs (N, m), in their units: u[k] is held from t[k] to t[k+1]."""
    w: np.ndarray | None = None
    """Unknown inputs (N, p) that really moved the path, held as u is, in their units; None where they are not known, which counts as 0."""
    tolerance: float = TOLERANCE
    """Relative error that steps along the path may have, in state and sensitivity, in (0, 1): what is made of the path takes as many
    sub-steps as that needs.
    """

    def __post_init__(self) -> None:
        require_tolerance(self.tolerance)
        for name in ("t", "x", "u") if self.w is None else ("t", "x", "u", "w"):
            values = as_array(f"trajectory: {name}", getattr(self, name))
            if not all_finite(values):
                first = np.argwhere(~np.isfinite(values))[0]
                raise InputError(f"trajectory: {name}[{', '.join(map(str, first))}] is {values[tuple(first)]}: must be finite")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        steps = self.t.size - 1
        if self.t.ndim != 1 or steps < 1 or self.x.ndim != 2 or self.u.ndim != 2 or len(self.x) != steps + 1 or len(self.u) != steps:
            raise InputError(
                f"trajectory: t {self.t.shape}, x {self.x.shape}, u {self.u.shape} do not fit: needs (N+1,), (N+1, n), (N, m), N > 0"
            )
        if self.w is not None and (self.w.ndim != 2 or len(self.w) != steps):
            raise InputError(f"trajectory: w has shape {self.w.shape}: must be ({steps}, p), a row for each row of u")
        require_positive("trajectory: step", float(self.t[1] - self.t[0]))
        backwards = np.flatnonzero(np.diff(self.t) <= 0)
        if len(backwards):
            k = int(backwards[0]) + 1
            raise InputError(f"trajectory: t[{k}] is {self.t[k]:.12g} after {self.t[k - 1]:.12g}: times must increase")

    @cached_property
    def substeps(self) -> WeakKeyDictionary[object, int]:
        """Of how many sub-steps the steps of a model have to be made along this path, as far as that was found out."""
        return WeakKeyDictionary()

    def __getstate__(self) -> dict[str, object]:
        """What is written when a path is sent to another process: what was found out stays here."""
        return {name: value for name, value in self.__dict__.items() if name != "substeps"}

    def to_dataframe(self) -> DataFrame:
        """Return times as the index, and columns x0.., u0.. (inputs from this time on, NaN at the last), w0.. where they are known.

        Raises MissingPackageError where pandas is not installed.
        """
        held = {"u": self.u} if self.w is None else {"u": self.u, "w": self.w}
        columns = {f"x{i}": column for i, column in enumerate(self.x.T)}
        columns |= {f"{name}{i}": np.append(column, np.nan) for name, values in held.items() for i, column in enumerate(values.T)}
        return data_frame(columns, {"t": self.t})

    def _summary(self) -> Summary:
        states = [
            (f"x[{i}]", f"{number(column[0])} to {number(column[-1])}, within {number(column.min())} to {number(column.max())}")
            for i, column in enumerate(self.x.T)
        ]
        inputs = [(f"u[{i}]", f"within {number(column.min())} to {number(column.max())}") for i, column in enumerate(self.u.T)]
        picture = state_picture(self.x)
        lengths = [number(length, "s") for length in (self.lengths.min(), self.lengths.max())]
        step = lengths[0] if self.is_even else " to ".join(lengths)
        title = f"path of {self.steps} steps of {step}, from {number(self.t[0], 's')} on"
        return Summary(title, (*states, *inputs), picture)

    def part(self, first: int, last: int) -> Trajectory:
        """Return the path from t[first] to t[last]; raise InputError unless 0 <= first < last <= N."""
        require_count("first", first, minimum=0, maximum=self.steps - 1)
        require_count("last", last, minimum=first + 1, maximum=self.steps)
        nodes, held = slice(first, last + 1), slice(first, last)
        part = Trajectory(self.t[nodes], self.x[nodes], self.u[held], None if self.w is None else self.w[held], self.tolerance)
        part.substeps.update(self.substeps)  # of which the whole is made: enough for a part
        return part

    @property
    def steps(self) -> int:
        """N."""
        return len(self.u)

    @cached_property
    def step(self) -> float:
        """Length of one step [s]; raises InputError where steps are not equal, to a millionth."""
        if not self.is_even:
            lengths = self.lengths
            raise InputError(f"path: its steps are {lengths.min():.6g} to {lengths.max():.6g} s long: for this they must be equal")
        return self._mean_step

    @property
    def pace(self) -> float:
        """What one step counts: its length [s] where all are equal, else 1, time being counted in steps."""
        return self._mean_step if self.is_even else 1.0

    @property
    def paces(self) -> np.ndarray:
        """What each step counts for errors that last (N,): 1 where all are equal, else its length [s]."""
        return np.ones(self.steps) if self.is_even else self.lengths

    @property
    def lengths(self) -> np.ndarray:
        """Lengths (N,) of the steps [s], the same number for equal ones."""
        return np.full(self.steps, self._mean_step) if self.is_even else np.diff(self.t)

    @cached_property
    def is_even(self) -> bool:
        """Whether all steps are equal, to a millionth of them and the rounding of times."""
        rounding = 4 * np.finfo(float).eps * float(np.abs(self.t[[0, -1]]).max())
        return bool(np.abs(np.diff(self.t) - self._mean_step).max() <= max(1e-6 * self._mean_step, min(rounding, 1e-3 * self._mean_step)))

    @cached_property
    def _mean_step(self) -> float:
        # of the whole span: the difference of two neighbouring times carries their round-off; a number of 12 digits where that is all it is
        mean, eps = float(self.t[-1] - self.t[0]) / (len(self.t) - 1), float(np.finfo(float).eps)
        rounding = 2 * eps * (mean + float(np.abs(self.t[[0, -1]]).max()) / (len(self.t) - 1))
        rounded = float(f"{mean:.12g}")
        return rounded if abs(rounded - mean) <= rounding else mean


def uneven_path_of(path: Trajectory, t: np.ndarray, x: np.ndarray, u: np.ndarray, w: np.ndarray | None) -> Trajectory:
    """Return the path through other instants, whose steps may be of any length and of none; as `path_of` makes it."""
    result = path_of(t, x, u, w, path.tolerance)
    vars(result).update(is_even=False)
    return result


def even_path_of(t: np.ndarray, x: np.ndarray, u: np.ndarray, w: np.ndarray | None, tolerance: float) -> Trajectory:
    """Return the path through instants that are made to be equally far apart; as `path_of` makes it."""
    result = path_of(t, x, u, w, tolerance)
    vars(result).update(is_even=True)
    return result


def path_of(t: np.ndarray, x: np.ndarray, u: np.ndarray, w: np.ndarray | None, tolerance: float) -> Trajectory:
    """Return a path of finite arrays of floats that fit and that nobody else writes to, made just now: none is copied or checked."""
    for values in (t, x, u) if w is None else (t, x, u, w):
        values.setflags(write=False)
    path = object.__new__(Trajectory)
    vars(path).update(t=t, x=x, u=u, w=w, tolerance=tolerance)
    return path
