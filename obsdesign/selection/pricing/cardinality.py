"""Up to m sensors in each segment, each segment for itself."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

from obsdesign.selection.pricing.abstract import AbstractSchedules, AbstractSeparateSchedules, PatternChanges

_MAX_PATTERNS = 3000  # patterns of one segment that are listed


@dataclass(frozen=True, eq=False)
class CardinalitySchedules(AbstractSeparateSchedules):
    """At most per_segment of the available (K, S) sensors: the dearest ones, in closed form."""

    per_segment: int

    @property
    def is_linked(self) -> bool:
        """False: every segment is free of the others."""
        return False

    def maximise(self, price: np.ndarray, switching_cost: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the per_segment largest prices of each segment that are not negative; ties go to the first sensor."""
        available_price = np.where(self.available, price, -np.inf)
        if self.per_segment == 1:
            first = available_price.argmax(axis=1)
            worth = available_price[np.arange(len(first)), first]
            chosen = np.zeros(price.shape, dtype=bool)
            chosen[np.arange(len(first)), first] = worth >= 0
            return chosen, float(worth[worth >= 0].sum())
        order = np.argsort(-available_price, axis=1, kind="stable")[:, : self.per_segment]
        chosen = np.zeros(price.shape, dtype=bool)
        np.put_along_axis(chosen, order, True, axis=1)
        chosen &= available_price >= 0
        return chosen, float(price[chosen].sum())

    def forcing_costs(self, price: np.ndarray, switching_cost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return max(last one in - price, 0) for on, and max(price - first one out, 0) for off."""
        available_price = np.where(self.available, price, -np.inf)
        m = self.per_segment
        ranked = -np.sort(-available_price, axis=1)
        last_in = np.maximum(ranked[:, m - 1], 0.0)  # what has to leave for a newcomer
        first_out = np.maximum(ranked[:, m], 0.0) if m < price.shape[1] else np.zeros(len(price))
        on = np.maximum(last_in[:, None] - price, 0.0)
        off = np.maximum(price - first_out[:, None], 0.0)
        return np.where(self.available, on, np.inf), np.where(self.available, off, 0.0)

    def feasible_patterns(self, k: int, can_be_on: np.ndarray, can_be_off: np.ndarray, idle: bool) -> np.ndarray | None:
        """Return the sets of at most per_segment sensors; with idle False those without room left. None above 3000."""
        forced_on, free = np.flatnonzero(can_be_on & ~can_be_off), np.flatnonzero(can_be_on & can_be_off)
        if (~can_be_on & ~can_be_off).any() or len(forced_on) > self.per_segment:
            return np.zeros((0, len(can_be_on)), dtype=bool)
        slots = min(self.per_segment - len(forced_on), len(free))
        sizes = range(slots + 1) if idle else range(slots, slots + 1)
        if sum(comb(len(free), size) for size in sizes) > _MAX_PATTERNS:
            return None
        sets = [subset for size in sizes for subset in combinations(free, size)]
        patterns = np.zeros((len(sets), len(can_be_on)), dtype=bool)
        patterns[:, forced_on] = True
        for pattern, subset in zip(patterns, sets, strict=True):
            pattern[list(subset)] = True
        return patterns

    def cheapest_changes(self, chosen: np.ndarray, price: np.ndarray, segment_indices: np.ndarray, max_count: int) -> PatternChanges:
        """Return the exchanges of one sensor, or none, for another, or none."""
        # one sensor off or none, and one on or none: column S stands for none
        chosen, price = chosen[segment_indices], price[segment_indices]
        K, S = chosen.shape
        off = np.column_stack([np.where(chosen, price, np.inf), np.zeros(K)])
        on = np.column_stack([np.where(~chosen & self.available[segment_indices], price, -np.inf), np.zeros(K)])
        cost = off[:, :, None] - on[:, None, :]
        cost[:, S, S] = np.inf
        cost[chosen.sum(axis=1) >= self.per_segment, S, :] = np.inf
        flat = cost.ravel()
        cheapest = np.argpartition(flat, max_count)[:max_count] if len(flat) > max_count else np.arange(len(flat))
        cheapest = np.sort(cheapest[np.isfinite(flat[cheapest])])
        segments, rest = np.divmod(cheapest, (S + 1) ** 2)
        switched_off, switched_on = np.divmod(rest, S + 1)
        patterns = np.column_stack([chosen[segments], np.zeros(len(segments), dtype=bool)])
        patterns[np.arange(len(segments)), switched_off] = False
        patterns[np.arange(len(segments)), switched_on] = True
        return PatternChanges(segment_indices[segments], patterns[:, :S])


def top_of(schedules: AbstractSchedules) -> CardinalitySchedules:
    """Return schedules that are limited per segment alone, or raise TypeError for others, which a method that asks does not serve."""
    if not isinstance(schedules, CardinalitySchedules):
        raise TypeError(f"schedules are {type(schedules).__name__}: must be limited by a number of sensors per segment alone, Top")
    return schedules
