"""Patterns of sensors that follow each other: dwell times and switching, by dynamic programming over the segments."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from obsdesign.errors import InputError
from obsdesign.selection.pricing.abstract import AbstractSchedules
from obsdesign.selection.pricing.patterns import costs_of_forcing

_MAX_STATES = 3000  # each is followed by any of the patterns: trades the rules that are accepted for memory and time


@dataclass(frozen=True, eq=False)
class DwellChain(AbstractSchedules):
    """In every segment one of the patterns (P, S) of available (K, S) sensors; a sensor s that goes on stays on for dwell (S,).

    A state is a pattern and how long each of its sensors still has to stay on; the first state is nothing on, as before the path.
    """

    patterns: np.ndarray
    dwell: np.ndarray

    @property
    def is_linked(self) -> bool:
        """True: what is on stays on for its dwell."""
        return True

    def maximise(self, price: np.ndarray, switching_cost: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the best walk through the states, by backward dynamic programming."""
        scores, loss = self.scores(price), self.switch_ons @ switching_cost
        to_end = self._backward(scores, loss)
        chosen, state = np.empty(price.shape, dtype=bool), 0
        for k in range(len(price)):
            index = int((scores[k] - loss[state] + to_end[k + 1][self.transitions[state]]).argmax())
            chosen[k] = self.patterns[index]
            state = self.transitions[state, index]
        return chosen, float(to_end[0][0])

    def forcing_costs(self, price: np.ndarray, switching_cost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the best total, less that of all walks with (k, s) on, and off: forward and backward totals."""
        through = self.best_through(price, switching_cost)
        return costs_of_forcing(through.max(axis=1), self.patterns)

    def best_through(self, price: np.ndarray, switching_cost: np.ndarray) -> np.ndarray:
        """Return the best total (K, Q, P) of all schedules that take pattern p from state q in segment k; -inf where there is none."""
        scores, loss = self.scores(price), self.switch_ons @ switching_cost
        to_end, from_start = self._backward(scores, loss), self._forward(scores, loss)
        return from_start[:-1, :, None] + scores[:, None, :] - loss[None] + to_end[1:][:, self.transitions]

    def scores(self, price: np.ndarray) -> np.ndarray:
        """Return what each pattern is worth in each segment (K, P), -inf where a sensor of it is not available."""
        missing = (~self.available).astype(float) @ self.patterns.T
        return np.where(missing > 0, -np.inf, price @ self.patterns.T)

    def _backward(self, scores: np.ndarray, loss: np.ndarray) -> np.ndarray:
        """Best total (K+1, Q) from the beginning of a segment to the end, by state; -inf for the state that stands for `impossible`."""
        to_end = np.full((len(scores) + 1, self.state_count + 1), -np.inf)
        to_end[-1, :-1] = 0.0
        for k in range(len(scores) - 1, -1, -1):
            to_end[k, :-1] = (scores[k] - loss + to_end[k + 1][self.transitions]).max(axis=1)
        return to_end

    def _forward(self, scores: np.ndarray, loss: np.ndarray) -> np.ndarray:
        """Best total (K+1, Q) from the beginning to that of a segment."""
        from_start = np.full((len(scores) + 1, self.state_count), -np.inf)
        from_start[0, 0] = 0.0
        order, ends, targets = self._arrivals
        for k in range(len(scores)):
            total = (from_start[k][:, None] + scores[k] - loss).ravel()[order]
            from_start[k + 1, targets] = np.maximum.reduceat(total, ends)
        return from_start

    @property
    def state_count(self) -> int:
        """Q, the number of states."""
        return len(self.transitions)

    @cached_property
    def _arrivals(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The steps (q, p) sorted by where they lead, where each target begins, and the targets."""
        flat = self.transitions.ravel()
        order = np.argsort(flat, kind="stable")
        order = order[flat[order] < self.state_count]
        targets, ends = np.unique(flat[order], return_index=True)
        return order, ends, targets

    @cached_property
    def states(self) -> np.ndarray:
        """How long each sensor still has to stay on after this segment (Q, S), -1 = off: every combination that a walk may reach."""
        states = [(-1,) * self.patterns.shape[1]]
        for pattern in self.patterns:
            remaining = [range(self.dwell[s]) if on else (-1,) for s, on in enumerate(pattern)]
            if len(states) + np.prod([len(choices) for choices in remaining]) > _MAX_STATES:
                raise InputError(
                    f"the rules make more than {_MAX_STATES} states of {len(self.patterns)} patterns and dwell times "
                    f"{', '.join(str(int(length)) for length in self.dwell)}: fewer sensors per segment or shorter dwell times are accepted"
                )
            states += [state for state in product(*remaining) if state not in states[:1]]
        return np.array(states)

    @cached_property
    def transitions(self) -> np.ndarray:
        """The state (Q, P) that a pattern leads to; Q where it switches off too early."""
        after = np.where(self.states >= 0, np.maximum(self.states - 1, 0), self.dwell - 1)  # if on
        is_early = (self.states > 0).astype(float) @ ~self.patterns.T > 0
        # the states of a pattern stand one after the other, counted by what is left, of its last sensor fastest
        choices = np.where(self.patterns, self.dwell, 1)
        strides = np.cumprod(np.hstack([choices, np.ones((len(choices), 1), dtype=int)])[:, :0:-1], axis=1)[:, ::-1]
        is_something = self.patterns.any(axis=1)
        counts = np.where(is_something, choices.prod(axis=1), 0)
        first = np.where(is_something, 1 + np.cumsum(counts) - counts, 0)
        return np.where(is_early, len(self.states), first + after @ np.where(self.patterns, strides, 0).T)

    @cached_property
    def switch_ons(self) -> np.ndarray:
        """Which sensors a pattern switches on (Q, P, S)."""
        return (self.states[:, None, :] < 0) & self.patterns[None]
