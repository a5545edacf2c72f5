"""Up to m sensors in each segment, each segment for itself."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

from obsdesign.selection.pricing.abstract import AbstractSchedules, AbstractSeparate, Changes

_MOST_OPTIONS = 3000  # patterns of one segment that are listed


@dataclass(frozen=True, eq=False)
class Top(AbstractSeparate):
    """At most per_segment of the available (K, S) sensors: the dearest ones, in closed form."""

    per_segment: int

    @property
    def linked(self) -> bool:
        return False

    def best(self, price: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, float]:
        offered = np.where(self.available, price, -np.inf)
        if self.per_segment == 1:
            first = offered.argmax(axis=1)
            worth = offered[np.arange(len(first)), first]
            chosen = np.zeros(price.shape, dtype=bool)
            chosen[np.arange(len(first)), first] = worth >= 0
            return chosen, float(worth[worth >= 0].sum())
        order = np.argsort(-offered, axis=1, kind="stable")[:, : self.per_segment]
        chosen = np.zeros(price.shape, dtype=bool)
        np.put_along_axis(chosen, order, True, axis=1)
        chosen &= offered >= 0
        return chosen, float(price[chosen].sum())

    def regrets(self, price: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        offered = np.where(self.available, price, -np.inf)
        m = self.per_segment
        ranked = -np.sort(-offered, axis=1)
        last_in = np.maximum(ranked[:, m - 1], 0.0)  # what has to leave for a newcomer
        first_out = np.maximum(ranked[:, m], 0.0) if m < price.shape[1] else np.zeros(len(price))
        on = np.maximum(last_in[:, None] - price, 0.0)
        off = np.maximum(price - first_out[:, None], 0.0)
        return np.where(self.available, on, np.inf), np.where(self.available, off, 0.0)

    def options(self, k: int, can_be_on: np.ndarray, can_be_off: np.ndarray, idle: bool) -> np.ndarray | None:
        taken, free = np.flatnonzero(can_be_on & ~can_be_off), np.flatnonzero(can_be_on & can_be_off)
        if (~can_be_on & ~can_be_off).any() or len(taken) > self.per_segment:
            return np.zeros((0, len(can_be_on)), dtype=bool)
        room = min(self.per_segment - len(taken), len(free))
        sizes = range(room + 1) if idle else range(room, room + 1)
        if sum(comb(len(free), size) for size in sizes) > _MOST_OPTIONS:
            return None
        sets = [subset for size in sizes for subset in combinations(free, size)]
        patterns = np.zeros((len(sets), len(can_be_on)), dtype=bool)
        patterns[:, taken] = True
        for pattern, subset in zip(patterns, sets, strict=True):
            pattern[list(subset)] = True
        return patterns

    def changes(self, chosen: np.ndarray, price: np.ndarray, within: np.ndarray, most: int) -> Changes:
        # one sensor off or none, and one on or none: column S stands for none
        chosen, price = chosen[within], price[within]
        K, S = chosen.shape
        off = np.column_stack([np.where(chosen, price, np.inf), np.zeros(K)])
        on = np.column_stack([np.where(~chosen & self.available[within], price, -np.inf), np.zeros(K)])
        cost = off[:, :, None] - on[:, None, :]
        cost[:, S, S] = np.inf
        cost[chosen.sum(axis=1) >= self.per_segment, S, :] = np.inf
        flat = cost.ravel()
        near = np.argpartition(flat, most)[:most] if len(flat) > most else np.arange(len(flat))
        near = np.sort(near[np.isfinite(flat[near])])
        segments, rest = np.divmod(near, (S + 1) ** 2)
        leaves, comes = np.divmod(rest, S + 1)
        patterns = np.column_stack([chosen[segments], np.zeros(len(segments), dtype=bool)])
        patterns[np.arange(len(segments)), leaves] = False
        patterns[np.arange(len(segments)), comes] = True
        return Changes(within[segments], patterns[:, :S])


def top_of(schedules: AbstractSchedules) -> Top:
    """Return schedules that are limited per segment alone, or raise TypeError for others, which a method that asks does not serve."""
    if not isinstance(schedules, Top):
        raise TypeError(f"schedules are {type(schedules).__name__}: must be limited by a number of sensors per segment alone, Top")
    return schedules
