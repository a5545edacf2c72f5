"""The cheapest schedule that keeps a limit on what is judged, by trying all: plain NumPy, nothing from the library."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.kalman_reference import LinearRun, amounts, step_through


@dataclass(frozen=True, eq=False)
class Limit:
    """sqrt(trace of what is judged) is at most so much at all the instants that count, (N,) bool, but for `misses` of them."""

    at_most: float
    counts: np.ndarray
    misses: int = 0


@dataclass(frozen=True, eq=False)
class _Beginnings:
    """Schedules of the first segments: covariances (B, n, n) before the next, picks (B, j), how often each missed (B,)."""

    P: np.ndarray
    picks: np.ndarray
    missed: np.ndarray


def least_cost(run: LinearRun, options: np.ndarray, cost: np.ndarray, start: np.ndarray, limit: Limit) -> float:
    """Return the least cost of options (O, S) in each segment, per segment on and per switching on (S,); inf where none keeps the limit."""
    all_of = _Beginnings(run.P[None], np.zeros((1, 0), dtype=int), np.zeros(1, dtype=int))
    for j in range(run.segments):
        all_of = _with_segment(run, options, all_of, j, limit)
    if not len(all_of.picks):
        return np.inf
    chosen = options[all_of.picks]
    before = np.concatenate([np.zeros_like(chosen[:, :1]), chosen[:, :-1]], axis=1)
    return float((chosen.sum(axis=1) @ cost + (chosen & ~before).sum(axis=1) @ start).min())


def _with_segment(run: LinearRun, options: np.ndarray, beginnings: _Beginnings, j: int, limit: Limit) -> _Beginnings:
    """Try every option in segment j, and drop what has missed too often."""
    count, many = len(beginnings.picks), len(options)
    P, missed = np.repeat(beginnings.P, many, axis=0), np.repeat(beginnings.missed, many)
    picks = np.concatenate([np.repeat(beginnings.picks, many, axis=0), np.tile(np.arange(many), count)[:, None]], axis=1)
    for k in np.flatnonzero(run.segment == j):
        updated, P = step_through(run, P, options[picks[:, -1]], k)
        if limit.counts[k]:
            missed = missed + (amounts(run, updated) > limit.at_most**2)
            kept = missed <= limit.misses
            P, picks, missed = P[kept], picks[kept], missed[kept]
    return _Beginnings(P, picks, missed)
