"""The schedules that keep every rule but the resources: what is best among them for given prices, exactly."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class PatternChanges:
    """Other patterns (N, S) bool for segments (N,)."""

    segments: np.ndarray
    patterns: np.ndarray


@dataclass(frozen=True, eq=False)
class AbstractSchedules(ABC):
    """A set of schedules (K, S) over which a sum of prices is maximised exactly. Leaves are final.

    available (K, S) bool: where a sensor may be on at all.
    """

    available: np.ndarray

    @property
    @abstractmethod
    def is_linked(self) -> bool:
        """Whether what is on in one segment restricts the next."""

    @abstractmethod
    def maximise(self, price: np.ndarray, switching_cost: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the schedule with the largest sum of price (K, S) over what is on, less start (S,) per switching-on; and the sum."""

    @abstractmethod
    def forcing_costs(self, price: np.ndarray, switching_cost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return how much the largest sum falls when (k, s) is forced on, and when it is forced off, (K, S) each; inf: impossible."""


class AbstractSeparateSchedules(AbstractSchedules):
    """Schedules in which every segment is free of the others."""

    @abstractmethod
    def feasible_patterns(self, k: int, can_be_on: np.ndarray, can_be_off: np.ndarray, idle: bool) -> np.ndarray | None:
        """Return the patterns (A, S) of a segment within what may be on (S,) and off (S,); None where there are too many to list.

        idle: whether there may be room left, which is never better where sensors cost nothing.
        """

    @abstractmethod
    def cheapest_changes(self, chosen: np.ndarray, price: np.ndarray, segment_indices: np.ndarray, max_count: int) -> PatternChanges:
        """Return the changes of one segment of `segment_indices` each that cost least in prices (K, S), at most `max_count`."""
