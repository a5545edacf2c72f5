"""What stands on a map, and what follows from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from obsdesign.report.figures._drawing import WIDTH
from obsdesign.report.figures._map import Shape
from obsdesign.signals import Point

SIGMAS = 2.0  # half axes of the ellipses
_ELLIPSES = 12  # at most about so many: more hide each other and the path
_MAX_ENLARGEMENT = 1.4  # how much larger the map may become for a path that would otherwise leave it


@dataclass(frozen=True, eq=False)
class MapContents:
    """What stands on the map of a path; what follows from it is computed once."""

    place: np.ndarray
    """Positions (N+1, 2) of the path [m]."""
    nodes: np.ndarray
    """Steps (K+1,) between which its K segments lie."""
    shares: np.ndarray
    """What each segment adds to the information about the weakest direction (K,), adding up to 1."""
    seconds: float
    """How long a segment lasts [s]."""
    start: Mapping[str, float]
    """The state at the start by name: heading and wind are drawn as arrows."""
    shapes: Sequence[Shape] = ()
    """What the constraints draw."""
    landmarks: Sequence[Point] = ()
    """What the sensors look at [m]."""
    others: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Positions of other paths by name (., 2) [m]."""
    needed: frozenset[str] = frozenset()
    """Names of those that the frame shows whatever their size."""
    covariances: np.ndarray | None = None
    """Covariance of the position (N+1, 2, 2) [m^2] to draw as ellipses; None = none are drawn."""

    @cached_property
    def ellipse_steps(self) -> np.ndarray:
        """Steps at which an ellipse is drawn: ends of segments, about a dozen."""
        ends = self.nodes[1:]
        every = -(-len(ends) // _ELLIPSES)
        return ends[every - 1 :: every]

    @cached_property
    def half_axes(self) -> np.ndarray:
        """Larger half axis [m] of each ellipse."""
        if self.covariances is None:
            return np.zeros(len(self.ellipse_steps))
        return SIGMAS * np.sqrt(np.linalg.eigvalsh(self.covariances[self.ellipse_steps])[:, -1])

    @cached_property
    def ellipse_factor(self) -> int:
        """By how much ellipses are enlarged: the largest of 1, 2, 5, 10, ... that leaves them about 4 % of the map."""
        low, high = self.extent
        typical = float(np.median(self.half_axes))
        factors = [digit * 10**power for power in range(6) for digit in (1, 2, 5)]
        return max([factor for factor in factors if factor * typical <= 0.04 * float(np.max(high - low))], default=1)

    @cached_property
    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (2,) [m] of the path, landmarks and constraints, and of other paths that do not need a much larger map."""
        points = [self.place, *(place for name, place in self.others.items() if name in self.needed)]
        points += [shape.points for shape in self.shapes if not shape.is_wide]
        points += [np.array([point]) for point in self.landmarks]
        low, high = np.vstack(points).min(axis=0), np.vstack(points).max(axis=0)
        size = float(np.max(high - low))
        for place in (place for name, place in self.others.items() if name not in self.needed):
            lower, higher = np.minimum(low, place.min(axis=0)), np.maximum(high, place.max(axis=0))
            if np.max(higher - lower) <= _MAX_ENLARGEMENT * size:
                low, high = lower, higher
        return low, high

    @cached_property
    def frame(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners (2,) of the frame [m]: what the map is about and the ellipses, with a margin."""
        low, high = self.extent
        place, reach = self.place[self.ellipse_steps], self.ellipse_factor * self.half_axes[:, None]
        low, high = np.minimum(low, (place - reach).min(axis=0)), np.maximum(high, (place + reach).max(axis=0))
        margin = 0.05 * float(np.max(high - low))
        return low - margin, high + margin

    @property
    def height(self) -> float:
        """Height of the figure [inches]."""
        low, high = self.frame
        return float(np.clip((WIDTH - 0.9) * (high - low)[1] / (high - low)[0], 1.6, 5.4)) + 2.1

    def leaves(self, name: str) -> bool:
        """Whether another path goes on beyond the frame."""
        low, high = self.frame
        return bool(np.any(self.others[name] < low) or np.any(self.others[name] > high))
