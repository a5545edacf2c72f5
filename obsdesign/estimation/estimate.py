"""What a filter or a smoother made of samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.display import AbstractDisplay, Summary, data_frame, number

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False)
class Estimate(AbstractDisplay):
    """Estimates of the state along N steps, with what became of the samples.

    Values at t_k are after the samples of that instant, predicted at t_N; of a smoother, given all samples.
    """

    t: np.ndarray
    """Instants (N+1,) [s]."""
    mean: np.ndarray
    """Estimated states (N+1, n), in their units; headings are continuous."""
    covariance: np.ndarray
    """Covariance (N+1, n, n) of their errors, in the units of the states."""
    innovations: np.ndarray
    """Residuals (N, q) of the outputs before the samples are taken in, in their units, angles wrapped; NaN without a sample."""
    innovation_std: np.ndarray
    """What the filter expected of them (N, q): the root of the diagonal of S, in the units of the outputs; NaN without a sample."""
    nis: np.ndarray
    """Normalised squares e' S^-1 e (N, S) of each sensor's sample: its number of outputs on average; NaN without a sample."""
    arrived: np.ndarray
    """Which sensors had a sample (N, S), bool."""
    rejected: np.ndarray
    """Which of these samples the gate kept out (N, S), bool."""
    alarms: np.ndarray
    """Where the gate found that the filter was wrong, and inflated its covariance (N, S), bool."""
    unusable: np.ndarray
    """Samples that could not be predicted (N, S), bool: the sensor's equations have no finite value or derivative at the estimate."""
    states: tuple[str, ...]
    """Names of the n states."""
    sensors: tuple[str, ...]
    """Names of the S sensors."""

    @property
    def std(self) -> np.ndarray:
        """Standard deviation (N+1, n) of each state's error, in its unit."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on samples that were not taken in."""
        return tuple(note for s, name in enumerate(self.sensors) for note in self._notes_on(s, name))

    def _notes_on(self, s: int, name: str) -> list[str]:
        arrived, rejected, unusable, alarms = (int(np.sum(v[:, s])) for v in (self.arrived, self.rejected, self.unusable, self.alarms))
        notes = []
        if unusable:
            notes.append(f"{name}: {unusable} of {arrived} samples could not be predicted, first at {self._first(self.unusable, s)}")
        if rejected:
            notes.append(f"{name}: {rejected} of {arrived} samples rejected by the gate, first at {self._first(self.rejected, s)}")
        if alarms:
            times = "once" if alarms == 1 else f"{alarms} times"
            notes.append(f"{name}: the filter was locked out {times}, first noticed at {self._first(self.alarms, s)}: covariance inflated")
        if rejected > 0.5 * max(arrived, 1):
            notes.append(f"{name}: more samples were rejected than taken in: it does not fit the model or the other sensors")
        return notes

    def _first(self, where: np.ndarray, s: int) -> str:
        return f"t = {self.t[int(np.argmax(where[:, s]))]:g} s"

    def to_dataframe(self) -> DataFrame:
        """Return times as the index, and a column for each state and its standard deviation.

        Raises MissingPackageError where pandas is not installed.
        """
        columns = dict(zip(self.states, self.mean.T, strict=True))
        columns |= {f"{name}_std": column for name, column in zip(self.states, self.std.T, strict=True)}
        return data_frame(columns, {"t": self.t})

    def _summary(self) -> Summary:
        last = zip(self.states, self.mean[-1], self.std[-1], strict=True)
        rows = [(f"{name} at the end", f"{number(mean)} +- {number(std)}") for name, mean, std in last]
        rows += [(name, f"{int(self.arrived[:, s].sum())} samples") for s, name in enumerate(self.sensors)]
        rows += [("note", note) for note in self.notes]
        return Summary(f"estimate of {len(self.states)} states over {len(self.t) - 1} steps", tuple(rows))
