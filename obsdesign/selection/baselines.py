"""What one would do without thinking: schedules to compare with."""

from __future__ import annotations

import numpy as np


def single_sensor(segments: int, sensors: int, sensor: int) -> np.ndarray:
    """Return (K, S): one sensor on throughout."""
    chosen = np.zeros((segments, sensors), dtype=bool)
    chosen[:, sensor] = True
    return chosen


def round_robin(segments: int, sensors: int, per_segment: int = 1) -> np.ndarray:
    """Return (K, S): each sensor in turn, per_segment at a time."""
    first = per_segment * np.arange(segments)[:, None]
    chosen = np.zeros((segments, sensors), dtype=bool)
    np.put_along_axis(chosen, (first + np.arange(per_segment)) % sensors, True, axis=1)
    return chosen


def random_schedule(segments: int, sensors: int, per_segment: int, random: np.random.Generator) -> np.ndarray:
    """Return (K, S): per_segment sensors drawn anew for each segment."""
    order = random.permuted(np.tile(np.arange(sensors), (segments, 1)), axis=1)
    return order < per_segment
