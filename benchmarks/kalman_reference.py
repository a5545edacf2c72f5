"""A Kalman filter in plain NumPy, and schedules for it by trying all, greedily and by a trellis: nothing in here comes from the library.

All recursions run for B schedules at once, and every sample is a row c with c'c / 1 its information, so that its noise has variance 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np


@dataclass(frozen=True, eq=False)
class LinearRun:
    """N steps x_k+1 = F_k x_k + noise of covariance Q, samples c x_k + noise of variance 1, cut into K segments, and what is judged.

    F (N, n, n), Q (n, n), P (n, n) at the start, rows (N, S, q, n) with zeros where nothing arrives, segment (N,) of each step; selection
    (a, n) takes the states that are judged, in their units; weights (N,), or None for the largest; criterion as in `amounts`.
    """

    F: np.ndarray
    Q: np.ndarray
    P: np.ndarray
    rows: np.ndarray
    segment: np.ndarray
    selection: np.ndarray
    weights: np.ndarray | None
    criterion: str = "trace"

    @property
    def segments(self) -> int:
        """K."""
        return int(self.segment[-1]) + 1

    @property
    def sensors(self) -> int:
        """S."""
        return self.rows.shape[1]


def covariances(run: LinearRun, chosen: np.ndarray) -> np.ndarray:
    """Return P (B, N, n, n) after the samples of each instant, for schedules (B, K, S)."""
    P, out = np.broadcast_to(run.P, (len(chosen), *run.P.shape)), []
    for k in range(len(run.F)):
        updated, P = step_through(run, P, chosen[:, run.segment[k]], k)
        out.append(updated)
    return np.stack(out, axis=1)


def step_through(run: LinearRun, P: np.ndarray, on: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariances (B, n, n) after the samples of t_k of the sensors that are on, (B, S), and those before t_k+1."""
    updated = _update(P, run.rows[k], on)
    return updated, run.F[k] @ updated @ run.F[k].T + run.Q


def _update(P: np.ndarray, rows: np.ndarray, on: np.ndarray) -> np.ndarray:
    """P - K S K' with the rows (S, q, n) of the sensors that are on, (B, S), one row after the other."""
    for s, q in np.ndindex(rows.shape[:2]):
        c = rows[s, q]
        if c.any():
            cross = P @ c
            gain = cross / (1.0 + cross @ c)[:, None] * on[:, s, None]
            P = P - gain[:, :, None] * cross[:, None, :]
    return P


def amounts(run: LinearRun, P: np.ndarray) -> np.ndarray:
    """Return what each of the covariances (..., n, n) costs: trace, largest eigenvalue ("largest") or "log det" of what is judged."""
    judged = run.selection @ P @ run.selection.T
    if run.criterion == "trace":
        return np.trace(judged, axis1=-2, axis2=-1)
    if run.criterion == "largest":
        return np.linalg.eigvalsh(judged)[..., -1]
    return np.linalg.slogdet(judged)[1]


def costs(run: LinearRun, chosen: np.ndarray) -> np.ndarray:
    """Return the cost (B,) of schedules (B, K, S)."""
    each = amounts(run, covariances(run, chosen))
    return each.max(axis=1) if run.weights is None else each @ run.weights


def patterns(sensors: int, per_segment: int, fewer: bool = True) -> np.ndarray:
    """Return (O, S) bool: all ways to have at most (fewer) or exactly so many sensors on."""
    counts = range(per_segment + 1) if fewer else (min(per_segment, sensors),)
    sets = [each for count in counts for each in combinations(range(sensors), count)]
    out = np.zeros((len(sets), sensors), dtype=bool)
    for row, each in zip(out, sets, strict=True):
        row[list(each)] = True
    return out


def all_schedules(segments: int, options: np.ndarray) -> np.ndarray:
    """Return (O^K, K, S) bool: every schedule of the options (O, S)."""
    picks = np.array(list(product(range(len(options)), repeat=segments)))
    return options[picks]


def random_schedules(run: LinearRun, per_segment: int, count: int, seed: int) -> np.ndarray:
    """Return (count, K, S) bool: drawn anew for each segment, as many on as there may be."""
    options, draw = patterns(run.sensors, per_segment, fewer=False), np.random.default_rng(seed)
    return options[draw.integers(0, len(options), (count, run.segments))]


def round_robin(segments: int, sensors: int, per_segment: int = 1) -> np.ndarray:
    """Return (K, S) bool: each in turn."""
    out = np.zeros((segments, sensors), dtype=bool)
    for k in range(segments):
        out[k, (per_segment * k + np.arange(per_segment)) % sensors] = True
    return out


def trellis(run: LinearRun, options: np.ndarray, memory: int = 0) -> np.ndarray:
    """Return a schedule (K, S) bool: forward, for every choice of the last `memory` segments the cheapest so far survives.

    memory = 0 is greedy: in each segment the option that costs least in it. With weights, or for a mean; not for the largest.
    """
    weights = np.ones(len(run.F)) if run.weights is None or not run.weights.any() else run.weights
    P, spent, past = run.P[None], np.zeros(1), np.zeros((1, 0), dtype=int)
    for j in range(run.segments):
        P, added = _segment(run, P, options, j, weights)
        spent = (spent[:, None] + added).ravel()
        past = np.concatenate([np.repeat(past, len(options), axis=0), np.tile(np.arange(len(options)), len(past))[:, None]], axis=1)
        best = _cheapest(spent, past[:, max(past.shape[1] - memory, 0) :] if memory else past[:, :0])
        P, spent, past = P[best], spent[best], past[best]
    return options[past[np.argmin(spent)]]


def _segment(run: LinearRun, P: np.ndarray, options: np.ndarray, j: int, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Carry B covariances through segment j under each option: (B O, n, n) and what it costs (B, O)."""
    count, added = len(P), np.zeros(len(P) * len(options))
    P, on = np.repeat(P, len(options), axis=0), np.tile(options, (len(P), 1))
    for k in np.flatnonzero(run.segment == j):
        updated, P = step_through(run, P, on, k)
        added += weights[k] * amounts(run, updated)
    return P, added.reshape(count, -1)


def _cheapest(spent: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Return the index of the cheapest of each group of equal rows."""
    if not groups.shape[1]:
        return np.array([np.argmin(spent)])
    order = np.argsort(spent, kind="stable")
    return order[np.unique(groups[order], axis=0, return_index=True)[1]]


def mean_weights(steps: int) -> np.ndarray:
    """Return weights (N,) of the mean over the instants."""
    return np.full(steps, 1.0 / steps)


def last_weights(steps: int) -> np.ndarray:
    """Return weights (N,) of the last instant alone."""
    return np.eye(steps)[-1]


def switched_on(chosen: np.ndarray) -> np.ndarray:
    """Return (B, S): how often each sensor of schedules (B, K, S) is switched on, the first segment included."""
    before = np.concatenate([np.zeros_like(chosen[:, :1]), chosen[:, :-1]], axis=1)
    return (chosen & ~before).sum(axis=1)
