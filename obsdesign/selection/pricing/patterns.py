"""Patterns of sensors that may be on together, each segment for itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.selection.pricing.abstract import AbstractSeparate, Changes

_CELLS = 4_000_000  # scores held at a time: 32 MB of doubles


@dataclass(frozen=True, eq=False)
class Groups(AbstractSeparate):
    """In every segment one of the patterns (P, S) bool, of sensors that are all available (K, S) there."""

    patterns: np.ndarray

    @property
    def linked(self) -> bool:
        return False

    def best(self, price: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, float]:
        chosen, total = np.empty(price.shape, dtype=bool), 0.0
        for part, scores in self._scores(price):
            index = scores.argmax(axis=1)
            chosen[part] = self.patterns[index]
            total += float(scores[np.arange(len(index)), index].sum())
        return chosen, total

    def regrets(self, price: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        on, off = np.empty(price.shape), np.empty(price.shape)
        for part, scores in self._scores(price):
            on[part], off[part] = forced(scores, self.patterns)
        return on, off

    def options(self, k: int, can_be_on: np.ndarray, can_be_off: np.ndarray, idle: bool) -> np.ndarray | None:
        patterns = self.patterns[~(self.patterns & ~self.available[k]).any(axis=1)]
        return patterns[~(patterns & ~can_be_on).any(axis=1) & ~(~patterns & ~can_be_off).any(axis=1)]

    def changes(self, chosen: np.ndarray, price: np.ndarray, within: np.ndarray, most: int) -> Changes:
        there = Groups(self.available[within], self.patterns)
        chosen, price = chosen[within], price[within]
        segments, patterns, cost = [], [], []
        for part, scores in there._scores(price):
            loss = (price[part] * chosen[part]).sum(axis=1)[:, None] - scores
            same = (self.patterns[None] == chosen[part][:, None]).all(axis=2)
            loss = np.where(same, np.inf, loss).ravel()
            near = np.argpartition(loss, most)[:most] if len(loss) > most else np.arange(len(loss))
            near = near[np.isfinite(loss[near])]
            segments.append(part.start + near // len(self.patterns))
            patterns.append(self.patterns[near % len(self.patterns)])
            cost.append(loss[near])
        order = np.argsort(np.concatenate(cost), kind="stable")[:most]
        return Changes(within[np.concatenate(segments)[order]], np.concatenate(patterns)[order])

    def _scores(self, price: np.ndarray):  # noqa: ANN202
        """Yield (slice, scores (., P)) of a few segments at a time, -inf for patterns with a sensor that is not available."""
        size = max(1, _CELLS // len(self.patterns))
        for first in range(0, len(price), size):
            part = slice(first, first + size)
            missing = (~self.available[part]).astype(float) @ self.patterns.T
            yield part, np.where(missing > 0, -np.inf, price[part] @ self.patterns.T)


def forced(scores: np.ndarray, patterns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what is lost when a sensor is forced on, and off, (K, S) each, of the best totals (K, P) with each pattern."""
    best = scores.max(axis=1)
    on, off = np.full((2, len(scores), patterns.shape[1]), np.inf)
    for s in range(patterns.shape[1]):
        for found, members in ((on, patterns[:, s]), (off, ~patterns[:, s])):
            if members.any():
                found[:, s] = best - scores[:, members].max(axis=1)
    return on, off
