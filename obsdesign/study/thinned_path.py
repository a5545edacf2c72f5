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
    """A path given as way points, and flown through them as an autopilot does.

    points: indices of the M nodes that are way points; of: how many nodes there are; tolerance [m] or every [s]: how they were taken.
    deviation: farthest that the flown path is from the given one [m]; durations: given and flown [s]; reached: whether the last way
    point was. smallest_eigenvalue: lambda_min of S W S, all sensors on, given and flown; std: of what the filter knows at the end with the
    schedule, (2, n), given and flown, in units of the states; broken: limits that the flown path breaks and the given one keeps.
    """

    points: tuple[int, ...]
    of: int
    tolerance: float | None
    every: float | None
    autopilot: Autopilot
    deviation: float
    durations: tuple[float, float]
    reached: bool
    smallest_eigenvalue: tuple[float, float]
    states: tuple[str, ...]
    units: tuple[str, ...]
    std: np.ndarray
    broken: tuple[str, ...]

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
