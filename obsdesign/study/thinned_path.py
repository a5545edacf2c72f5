"""Few points of a path that stay within a tolerance of all of it, and what flying through them alone costs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from obsdesign.checks import require_positive

Autopilot = Literal["px4", "ardupilot"]


@dataclass(frozen=True, eq=False)
class ThinnedPath:
    """A path given as way points, and what it costs to fly through them as an autopilot does."""

    points: tuple[int, ...]
    """Indices of the M nodes of the path that are way points."""
    of: int
    """How many nodes the path has."""
    tolerance: float | None
    """How near the path stays to its way points [m]; None where they were taken by time."""
    every: float | None
    """One way point every so many seconds [s]; None where they were taken by tolerance."""
    autopilot: Autopilot
    """Whose guidance flew."""
    deviation: float
    """Farthest that the flown path is from the given one [m]."""
    durations: tuple[float, float]
    """Of the path and of the flight [s]."""
    reached: bool
    """Whether the last way point was reached."""
    smallest_eigenvalue: tuple[float, float]
    """lambda_min of S W S, all sensors on, of the path and of the flight; no unit."""
    states: tuple[str, ...]
    """Names of the n states."""
    units: tuple[str, ...]
    """Their units."""
    std: np.ndarray
    """Standard deviations (2, n) of the filter at the end with the schedule, of the path and of the flight, in units of the states."""
    broken: tuple[str, ...]
    """Limits that the flight breaks and the path keeps, in words."""

    @property
    def in_words(self) -> str:
        """What the way points cost, in one sentence."""
        given, flown = self.smallest_eigenvalue
        taken = f"within {self.tolerance:g} m of the path" if self.every is None else f"one every {self.every:g} s"
        changes = [
            f"{name} {before:.3g} -> {after:.3g} {unit}"
            for name, before, after, unit in zip(self.states, *self.std.tolist(), self.units, strict=True)
        ]
        end = "" if self.reached else "; the last way point was not reached"
        limits = f"; flown it breaks {'; '.join(self.broken)}" if self.broken else ""
        return (
            f"{len(self.points)} of {self.of} points, {taken}; flown by {self.autopilot}'s guidance at most {self.deviation:.3g} m away, "
            f"{self.durations[1]:g} s instead of {self.durations[0]:g} s: lambda_min {given:.4g} -> {flown:.4g}, standard deviations of "
            f"the filter at the end: {', '.join(changes)}{end}{limits}"
        )


def thin(position: np.ndarray, tolerance: float, always: tuple[int, ...] = ()) -> np.ndarray:
    """Return the indices (M,) of points of a polyline (N, 2) such that no point is farther than the tolerance [m] from the thinned one.

    always: indices that stay. Raises InputError for a tolerance that is not above 0.
    Source: Ramer 1972, Douglas and Peucker 1973; distances are to segments, so that a path that turns back is followed.
    """
    require_positive("tolerance", tolerance)
    ends = sorted({0, len(position) - 1, *always})
    stays = np.zeros(len(position), dtype=bool)
    stays[ends] = True
    stretches = list(pairwise(ends))
    while stretches:
        first, last = stretches.pop()
        if last - first < 2:
            continue
        distances = segment_distances(position[first + 1 : last], position[first], position[last])
        k = int(np.argmax(distances))
        if distances[k] > tolerance:
            middle = first + 1 + k
            stays[middle] = True
            stretches += [(first, middle), (middle, last)]
    return np.flatnonzero(stays)


def points_every(t: np.ndarray, every: float, always: tuple[int, ...] = ()) -> np.ndarray:
    """Return the indices of the first instant (N,) [s] of every period [s], of the last, and those that stay."""
    require_positive("every", every)
    periods = np.floor((t - t[0]) / every + 1e-9).astype(np.int64)
    first = np.append(True, np.diff(periods) > 0)
    first[[-1, *always]] = True
    return np.flatnonzero(first)


def segment_distances(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the distances (N,) of points (N, 2) from the segments from start to end, each (2,) or (N, 2)."""
    along, offset = end - start, points - start
    length = np.sum(along * along, axis=-1)
    share = np.clip(np.sum(offset * along, axis=-1) / np.where(length > 0, length, 1.0), 0.0, 1.0)
    return np.linalg.norm(offset - share[..., None] * along, axis=-1)


def polyline_distances(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Return the distances (N,) of points (N, 2) from a polyline (M, 2) of short steps: from those beside its nearest vertex."""
    from scipy.spatial import KDTree

    nearest = KDTree(line).query(points)[1]
    before, after = np.maximum(nearest - 1, 0), np.minimum(nearest + 1, len(line) - 1)
    return np.minimum(segment_distances(points, line[before], line[nearest]), segment_distances(points, line[nearest], line[after]))
