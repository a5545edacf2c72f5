"""Patterns of sensors that follow each other: dwell times and switching, by dynamic programming over the segments."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from obsdesign.errors import InputError
from obsdesign.selection.pricing.abstract import AbstractSchedules
from obsdesign.selection.pricing.patterns import forced

_MOST_STATES = 3000  # each is followed by any of the patterns: trades the rules that are accepted for memory and time


@dataclass(frozen=True, eq=False)
class Chain(AbstractSchedules):
    """In every segment one of the patterns (P, S) of available (K, S) sensors; a sensor s that goes on stays on for dwell (S,).

    A state is a pattern and how long each of its sensors still has to stay on; the first state is nothing on, as before the path.
    """

    patterns: np.ndarray
    dwell: np.ndarray

    @property
    def linked(self) -> bool:
        return True

    def best(self, price: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, float]:
        scores, loss = self.scores(price), self.starts @ start
        ahead = self._backward(scores, loss)
        chosen, state = np.empty(price.shape, dtype=bool), 0
        for k in range(len(price)):
            index = int((scores[k] - loss[state] + ahead[k + 1][self.following[state]]).argmax())
            chosen[k] = self.patterns[index]
            state = self.following[state, index]
        return chosen, float(ahead[0][0])

    def regrets(self, price: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        through = self.through(price, start)
        return forced(through.max(axis=1), self.patterns)

    def through(self, price: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Return the best total (K, Q, P) of all schedules that take pattern p from state q in segment k; -inf where there is none."""
        scores, loss = self.scores(price), self.starts @ start
        ahead, behind = self._backward(scores, loss), self._forward(scores, loss)
        return behind[:-1, :, None] + scores[:, None, :] - loss[None] + ahead[1:][:, self.following]

    def scores(self, price: np.ndarray) -> np.ndarray:
        """Return what each pattern is worth in each segment (K, P), -inf where a sensor of it is not available."""
        missing = (~self.available).astype(float) @ self.patterns.T
        return np.where(missing > 0, -np.inf, price @ self.patterns.T)

    def _backward(self, scores: np.ndarray, loss: np.ndarray) -> np.ndarray:
        """Best total (K+1, Q) from the beginning of a segment to the end, by state; -inf for the state that stands for `impossible`."""
        ahead = np.full((len(scores) + 1, self.count + 1), -np.inf)
        ahead[-1, :-1] = 0.0
        for k in range(len(scores) - 1, -1, -1):
            ahead[k, :-1] = (scores[k] - loss + ahead[k + 1][self.following]).max(axis=1)
        return ahead

    def _forward(self, scores: np.ndarray, loss: np.ndarray) -> np.ndarray:
        """Best total (K+1, Q) from the beginning to that of a segment."""
        behind = np.full((len(scores) + 1, self.count), -np.inf)
        behind[0, 0] = 0.0
        order, ends, targets = self._arrivals
        for k in range(len(scores)):
            total = (behind[k][:, None] + scores[k] - loss).ravel()[order]
            behind[k + 1, targets] = np.maximum.reduceat(total, ends)
        return behind

    @property
    def count(self) -> int:
        """Q, the number of states."""
        return len(self.following)

    @cached_property
    def _arrivals(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The steps (q, p) sorted by where they lead, where each target begins, and the targets."""
        flat = self.following.ravel()
        order = np.argsort(flat, kind="stable")
        order = order[flat[order] < self.count]
        targets, ends = np.unique(flat[order], return_index=True)
        return order, ends, targets

    @cached_property
    def _states(self) -> list[tuple[int, ...]]:
        """How long each sensor still has to stay on after this segment, -1 = off: every combination that a walk may reach."""
        found = [(-1,) * self.patterns.shape[1]]
        for pattern in self.patterns:
            left = [range(self.dwell[s]) if on else (-1,) for s, on in enumerate(pattern)]
            if len(found) + np.prod([len(each) for each in left]) > _MOST_STATES:
                raise InputError(
                    f"the rules make more than {_MOST_STATES} states of {len(self.patterns)} patterns and dwell times "
                    f"{', '.join(str(int(each)) for each in self.dwell)}: fewer sensors per segment or shorter dwell times are accepted"
                )
            found += [state for state in product(*left) if state not in found[:1]]
        return found

    @cached_property
    def following(self) -> np.ndarray:
        """The state (Q, P) that a pattern leads to; Q where it switches off too early."""
        states = np.array(self._states)
        index = {state: i for i, state in enumerate(self._states)}
        after = np.where(states[:, None, :] >= 0, np.maximum(states[:, None, :] - 1, 0), self.dwell - 1)  # if on
        after = np.where(self.patterns[None], after, -1)
        early = (~self.patterns[None] & (states[:, None, :] > 0)).any(axis=2)
        found = np.full(early.shape, len(states))
        for q, p in np.argwhere(~early):
            found[q, p] = index[tuple(after[q, p].tolist())]
        return found

    @cached_property
    def starts(self) -> np.ndarray:
        """Which sensors a pattern switches on (Q, P, S)."""
        return (np.array(self._states)[:, None, :] < 0) & self.patterns[None]
