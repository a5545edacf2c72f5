"""A schedule for what a filter knows, with its certificate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.display import AbstractDisplay, Summary, data_frame, number, raster_picture, raster_text
from obsdesign.status import Status

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False)
class ComparedSchedule:
    """Another schedule for the same run: its name, what it has on (K, S), and its cost."""

    name: str
    """What it is called in tables."""
    chosen: np.ndarray
    """True where a sensor is on (K, S)."""
    value: float
    """Its cost: smaller is better."""


@dataclass(frozen=True, eq=False)
class FilterSchedule(AbstractDisplay):
    """Which sensors are on in which segment so that a filter knows most along the way, and a bound on what any schedule reaches.

    value: the cost of P_k, the covariance after the samples at t_k: smaller is better; bound <= the cost of every schedule that keeps the
    rules. gap = 1 - bound / value (value - bound for log det). Status OPTIMAL: the gap is closed; GAP_OPEN: it is not; INFEASIBLE: no
    schedule keeps the rules. Values are recomputed with `posterior_information`; NaN where there is no answer.
    """

    chosen: np.ndarray
    """True where a sensor is on (K, S), one row per segment."""
    value: float
    """The cost of the schedule: smaller is better."""
    bound: float
    """What no schedule that keeps the rules is below, in the unit of the cost."""
    gap: float
    """How far the value may be from the best."""
    predicted: np.ndarray
    """Standard deviations (N, n) of the state after the samples at t_k, in the units of the states."""
    status: Status
    """How the search ended."""
    bound_by: str
    """What proved the bound, in words."""
    memory: float
    """Segments until half of what a choice brings is forgotten; inf where it never is, NaN where there was no time to look."""
    prices: np.ndarray
    """What each sensor is worth in each segment (K, S): the cost without it less that with it, all else as chosen; NaN without time."""
    compared: tuple[ComparedSchedule, ...]
    """What others would do: each with its cost."""
    boundaries: np.ndarray
    """When segments begin and end (K+1,) [s]."""
    sensors: tuple[str, ...]
    """Names of the sensors (S)."""
    notes: tuple[str, ...] = ()
    """What went otherwise than planned, in words."""

    def to_dataframe(self) -> DataFrame:
        """Return a row for each segment, with the time it begins and a column for each sensor, true where it is on.

        Raises MissingPackageError where pandas is not installed.
        """
        return data_frame(dict(zip(self.sensors, self.chosen.T, strict=True)), {"t": self.boundaries[:-1]})

    def _summary(self) -> Summary:
        rows = [
            ("cost (smaller is better)", number(self.value)),
            ("no schedule is below", f"{number(self.bound)} (gap {number(self.gap)}, by {self.bound_by})"),
        ]
        if not np.isnan(self.memory):
            after = f"{number(self.memory)} segment{'' if self.memory == 1 else 's'}" if np.isfinite(self.memory) else "no time"
            rows.append(("half of a choice is forgotten after", after))
        rows += [(name, marks) for name, marks in zip(self.sensors, raster_text(self.chosen), strict=True)]
        rows += [(other.name, number(other.value)) for other in self.compared]
        if self.notes:
            rows.append(("notes", "; ".join(self.notes)))
        segments, sensors = self.chosen.shape
        title = f"schedule of {sensors} sensors in {segments} segments for the filter: {self.status.value}"
        return Summary(title, tuple(rows), raster_picture(self.chosen))
