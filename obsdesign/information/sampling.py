"""Which sensor is read at which step."""

from __future__ import annotations

import numpy as np

from obsdesign.compile import steps_per_sample
from obsdesign.system import AbstractSystem


def sampled(system: AbstractSystem, steps: int, step: float) -> np.ndarray:
    """Return (N, S) bool: True where sensor s has a sample at t_k; the first sample is at t_0."""
    periods = np.array(steps_per_sample(system, step), dtype=int).reshape(1, -1)
    return np.arange(steps)[:, None] % periods == 0
