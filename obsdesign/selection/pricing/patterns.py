"""Patterns of sensors that may be on together, each segment for itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.selection.pricing.abstract import AbstractSeparateSchedules, PatternChanges

_MAX_SCORES = 4_000_000  # scores held at a time: 32 MB of doubles


@dataclass(frozen=True, eq=False)
class PatternSchedules(AbstractSeparateSchedules):
    """In every segment one of the patterns (P, S) bool, of sensors that are all available (K, S) there."""

    patterns: np.ndarray

    @property
    def is_linked(self) -> bool:
        """False: every segment is free of the others."""
        return False

    def maximise(self, price: np.ndarray, switching_cost: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the pattern with the largest sum of prices in each segment."""
        chosen, total = np.empty(price.shape, dtype=bool), 0.0
        for part, scores in self._scores(price):
            index = scores.argmax(axis=1)
            chosen[part] = self.patterns[index]
            total += float(scores[np.arange(len(index)), index].sum())
        return chosen, total

    def forcing_costs(self, price: np.ndarray, switching_cost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the largest sum, less that over the patterns with a sensor on, and off."""
        on, off = np.empty(price.shape), np.empty(price.shape)
        for part, scores in self._scores(price):
            on[part], off[part] = costs_of_forcing(scores, self.patterns)
        return on, off

    def feasible_patterns(self, k: int, can_be_on: np.ndarray, can_be_off: np.ndarray, idle: bool) -> np.ndarray | None:
        """Return the patterns within what is available in the segment and may be on and off."""
        patterns = self.patterns[~(self.patterns & ~self.available[k]).any(axis=1)]
        return patterns[~(patterns & ~can_be_on).any(axis=1) & ~(~patterns & ~can_be_off).any(axis=1)]

    def cheapest_changes(self, chosen: np.ndarray, price: np.ndarray, segment_indices: np.ndarray, max_count: int) -> PatternChanges:
        """Return the changes to another pattern with the smallest loss of price."""
        subset = PatternSchedules(self.available[segment_indices], self.patterns)
        chosen, price = chosen[segment_indices], price[segment_indices]
        segments, patterns, cost = [], [], []
        for part, scores in subset._scores(price):
            loss = (price[part] * chosen[part]).sum(axis=1)[:, None] - scores
            same = (self.patterns[None] == chosen[part][:, None]).all(axis=2)
            loss = np.where(same, np.inf, loss).ravel()
            cheapest = np.argpartition(loss, max_count)[:max_count] if len(loss) > max_count else np.arange(len(loss))
            cheapest = cheapest[np.isfinite(loss[cheapest])]
            segments.append(part.start + cheapest // len(self.patterns))
            patterns.append(self.patterns[cheapest % len(self.patterns)])
            cost.append(loss[cheapest])
        order = np.argsort(np.concatenate(cost), kind="stable")[:max_count]
        return PatternChanges(segment_indices[np.concatenate(segments)[order]], np.concatenate(patterns)[order])

    def _scores(self, price: np.ndarray):  # noqa: ANN202
        """Yield (slice, scores (., P)) of a few segments at a time, -inf for patterns with a sensor that is not available."""
        size = max(1, _MAX_SCORES // len(self.patterns))
        for first in range(0, len(price), size):
            part = slice(first, first + size)
            missing = (~self.available[part]).astype(float) @ self.patterns.T
            yield part, np.where(missing > 0, -np.inf, price[part] @ self.patterns.T)


def costs_of_forcing(scores: np.ndarray, patterns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what is lost when a sensor is forced on, and off, (K, S) each, of the best totals (K, P) with each pattern."""
    best = scores.max(axis=1)
    on, off = np.full((2, len(scores), patterns.shape[1]), np.inf)
    for s in range(patterns.shape[1]):
        for cost, members in ((on, patterns[:, s]), (off, ~patterns[:, s])):
            if members.any():
                cost[:, s] = best - scores[:, members].max(axis=1)
    return on, off
