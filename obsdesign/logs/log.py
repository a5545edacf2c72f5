"""A recorded run: inputs, samples and truth, at the times at which they came; nothing is resampled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_positive
from obsdesign.display import AbstractDisplay, Summary, number
from obsdesign.errors import InputError
from obsdesign.logs.inputs import LogInputs
from obsdesign.logs.samples import LogSamples
from obsdesign.logs.truth import LogTruth

_SAME_TIME = 1e-9  # seconds that are no time at all


def shift_text(shifts: np.ndarray) -> str:
    """Return in words how many of K samples were moved, and by how much (K,) [s]; "" where none was."""
    moved = np.abs(shifts[np.abs(shifts) > _SAME_TIME])
    if not len(moved):
        return ""
    median, most = float(np.median(moved)), float(moved.max())
    return f"{len(moved)} of {len(shifts)} samples were moved to the grid, by {median:.3g} s (median), {most:.3g} s at most"


@validate_arguments
@dataclass(frozen=True, eq=False)
class Log(AbstractDisplay):
    """A recorded run. Times of inputs, samples and truth are seconds since the same instant.

    Raises InputError for a log without samples.
    """

    inputs: LogInputs | None
    """Readings of the known inputs; None for a system that has none."""
    samples: LogSamples
    """What the sensors said."""
    truth: LogTruth | None = None
    """What else is known of the states, in their units, for judging alone; None = nothing."""
    epoch: float | None = None
    """Unix time [s] of the instant that times count from; None = not known."""
    notes: tuple[str, ...] = ()
    """What was done to the file's numbers on the way here, in words."""

    def __post_init__(self) -> None:
        if not len(self.samples.t):
            raise InputError("log: there are no samples: nothing can be said about the state")

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s] of inputs and samples."""
        times = [self.samples.t] if self.inputs is None or not len(self.inputs.t) else [self.samples.t, self.inputs.t]
        return min(float(t[0]) for t in times), max(float(t[-1]) for t in times)

    def first(self, share: float) -> Log:
        """Return the log of the first share of the time, in (0, 1]; raise InputError for other shares."""
        if not 0 < share <= 1:
            raise InputError(f"share is {share!r}: must be a number above 0 and at most 1, of the time of the log")
        first, last = self.span
        return self.stretch(first, first + float(share) * (last - first))

    def stretch(self, first: float, last: float) -> Log:
        """Return the log from one time to another [s]; raise InputError where there are no samples."""
        samples = self.samples.where((self.samples.t >= first) & (self.samples.t <= last))
        inputs = None if self.inputs is None else self.inputs.stretch(first, last)
        truth = None if self.truth is None else self.truth.stretch(first, last)
        return Log(inputs, samples, truth, self.epoch, self.notes)

    def on_grid(self, step: float) -> Log:
        """Return the log with each sample moved to the nearest instant of a grid of `step` [s] from the log's beginning on.

        The notes say how many were moved, and by how much; none is left out, and inputs and truth stay. Raises InputError for a
        step that is not above 0.
        """
        require_positive("step", step)
        first, t = self.span[0], self.samples.t
        moved = first + np.rint((t - first) / step) * step
        samples = LogSamples(self.samples.names, moved, self.samples.sensor, self.samples.y, self.samples.sigma)
        note = shift_text(moved - t)
        return Log(self.inputs, samples, self.truth, self.epoch, (*self.notes, *((note,) if note else ())))

    def _summary(self) -> Summary:
        first, last = self.span
        rows = [(f"sensor {name}", f"{count} samples") for name, count in self.samples.counts.items()]
        if self.inputs is not None:
            kinds = [f"{name} ({'added up' if name in self.inputs.increments else 'held'})" for name in self.inputs.names]
            rows.insert(0, ("inputs", f"{', '.join(kinds)}: {len(self.inputs.t)} times"))
        if self.truth is not None:
            rows.insert(1, ("truth", f"{', '.join(self.truth.names)}: {len(self.truth.t)} times"))
        title = f"log of {number(last - first, 's')}, {len(self.samples.t)} samples"
        return Summary(title, (*rows, *(("note", note) for note in self.notes)))
