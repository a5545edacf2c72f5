"""What rules know of the segments of a path."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.rules.abstract import Segments
from obsdesign.trajectory import Trajectory


def segments_along(model: Model, path: Trajectory, nodes: np.ndarray) -> Segments:
    """Return names, times, and positions where the vehicle has any, of the segments of a path between nodes (K+1,), counted in steps."""
    columns = [model.state_names.index(name) for name in ("x", "y") if name in model.state_names]
    tracks = tuple(path.x[first : last + 1, columns] for first, last in pairwise(nodes)) if len(columns) == 2 else None
    return Segments(model.sensor_names, len(nodes) - 1, path.t[nodes], tracks)
