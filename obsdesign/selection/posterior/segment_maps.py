"""What a segment under an option makes of a covariance, and what it costs: maps that are computed once and applied to many at a time.

A filter that begins a segment at P = 0 ends it with P0; with Psi its closed-loop transition and O the sum of r r' over its samples, r'
the row of a sample about what the segment began with over the standard deviation of its innovation, a filter that begins at P ends
with P0 + Psi X Psi', X = (P^-1 + O)^-1. X is had from P by one rank-one step for each sample. What an instant costs where it is
linear in the covariance is a constant and <M, X>.

Arrays of batches have the batch last, (n, n, B), so that NumPy's loops run along it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.information.linear_model import LinearModel
from obsdesign.selection.posterior.batches import add_row, congruence
from obsdesign.selection.posterior.cost_maps import AbstractCostMaps, FilterMoment, Timetable, empty_cost_maps, timetable_of
from obsdesign.selection.posterior.instant_costs import InstantCosts

_BATCH = 512  # covariances at a time: what fits into a cache
_MAX_ENTRIES = 4_000_000  # numbers of one array while maps are computed: 32 MB


@dataclass(frozen=True, eq=False)
class SegmentMaps:
    """K segments under each of O options: option o of segment k is number k O + o of M = K O.

    rows (T, R, n, M): r of the samples at the T instants at most that a segment has samples at, R at most in one; is_sampled (T, R, M):
    where there is one, elsewhere r is 0. instants (K,): how many there are. Psi, P0 (n, n, M). costs: what is added after each of
    them. Of a stretch of a run, first: the run's number of its first segment, weights (K,): how much its segments count; None = 1.
    """

    options: int
    rows: np.ndarray
    is_sampled: np.ndarray
    instants: np.ndarray
    Psi: np.ndarray
    P0: np.ndarray
    costs: AbstractCostMaps
    first: int = 0
    weights: np.ndarray | None = None

    def stretch(self, first: int, weights: np.ndarray) -> SegmentMaps:
        """Return the maps of as many segments as there are weights (k,), from one on, numbered anew from 0."""
        return replace(self, instants=self.instants[first : first + len(weights)], first=self.first + first, weights=weights)

    def advance(self, segment: np.ndarray | int, option: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the costs (B,) of options (B,) in segments (B,) from covariances (n, n, B) before them, and those at their ends.

        Costs are (I, B) where there are several at once.
        """
        number = (segment + self.first) * self.options + option
        batches = [slice(first, first + _BATCH) for first in range(0, max(1, len(number)), _BATCH)]
        parts = [self._advance(number[batch], P[:, :, batch]) for batch in batches]
        cost, P_next = np.concatenate([cost for cost, _ in parts], axis=-1), np.concatenate([P_next for _, P_next in parts], axis=2)
        if self.weights is None:
            return cost, P_next
        weight = self.weights[number // self.options - self.first]
        return np.where(weight > 0, weight * cost, self.costs.nothing), P_next

    def _advance(self, number: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        X, cost = P, self.costs.before_samples(number, P)
        for t in range(int(self.instants[number // self.options - self.first].max(initial=0))):
            for rows, is_sampled in zip(self.rows[t], self.is_sampled[t], strict=True):
                X = _with_samples(X, rows.take(number, axis=1), is_sampled[number])
            cost = self.costs.add(cost, t + 1, number, X)
        return cost, self.P0.take(number, axis=2) + congruence(self.Psi.take(number, axis=2), X)


def _with_samples(X: np.ndarray, rows: np.ndarray, is_sampled: np.ndarray) -> np.ndarray:
    """Return X (n, n, B) with rows (n, B) of samples, where there is one (B,)."""
    if is_sampled.all():
        return add_row(X, rows)
    if is_sampled.any():
        some = np.flatnonzero(is_sampled)
        X = X.copy()
        X[:, :, some] = add_row(X.take(some, axis=2), rows.take(some, axis=1))
    return X


def segment_maps(
    model: LinearModel, nodes: np.ndarray, patterns: np.ndarray, costs: InstantCosts | tuple[InstantCosts, ...]
) -> SegmentMaps:
    """Return the maps of the segments between nodes (K+1,), counted in steps, under patterns (O, S) of sensors, or (K, O, S) of each."""
    K, options, n = len(nodes) - 1, patterns.shape[-2], model.initial_covariance.shape[0]
    has_cost = np.any([part.weights > 0 for part in (costs if isinstance(costs, tuple) else (costs,))], axis=0)
    timetable = timetable_of(np.asarray(model.rows.any(axis=(1, 2))), has_cost, nodes)
    is_on = patterns[..., model.sensor_of_row]
    T, R = int(timetable.instants.max(initial=0)), max(1, int(is_on.sum(axis=-1).max()))
    maps = SegmentMaps(
        options,
        np.zeros((T, R, n, K * options)),
        np.zeros((T, R, K * options), dtype=bool),
        timetable.instants,
        np.zeros((n, n, K * options)),
        np.zeros((n, n, K * options)),
        empty_cost_maps(costs, timetable, n, options),
    )
    size = max(1, _MAX_ENTRIES // (options * n * n))
    for first in range(0, K, size):
        part = slice(first, min(first + size, K))
        _fill(maps, model, timetable, np.arange(K)[part], np.broadcast_to(is_on, (K, *is_on.shape[-2:]))[part])
    return maps


def _fill(maps: SegmentMaps, model: LinearModel, timetable: Timetable, segments: np.ndarray, is_on: np.ndarray) -> None:
    """Run filters from P = 0 through some of the segments, all options at once, and write what they meet into the maps.

    is_on (k, O, q): which outputs are on. Filters are numbered as the maps are, one segment's options after the other.
    """
    n, options = model.initial_covariance.shape[0], maps.options
    slot_of_output = (np.cumsum(is_on, axis=2) - 1).reshape(-1, is_on.shape[2])
    number, is_on = (segments[:, None] * options + np.arange(options)).ravel(), is_on.reshape(-1, is_on.shape[2])
    P, Psi = np.zeros((n, n, len(number))), np.repeat(np.eye(n)[:, :, None], len(number), axis=2)
    for t in range(int(timetable.lengths[segments].max())):
        is_running = t < timetable.lengths[segments]
        step = np.where(is_running, timetable.starts[segments] + t, 0)
        after = timetable.samples_until[segments, np.minimum(t, timetable.samples_until.shape[1] - 1)]
        slot = np.repeat(after - 1, options)
        for i in range(model.rows.shape[1]):
            row = np.repeat(np.where(is_running[:, None], model.rows[step, i], 0.0), options, axis=0).T * is_on[:, i]
            met = np.flatnonzero(row.any(axis=0))
            if len(met):
                g, P[:, :, met], Psi[:, :, met] = _sample(row[:, met], P[:, :, met], Psi[:, :, met])
                maps.rows[slot[met], slot_of_output[met, i], :, number[met]] = g.T
                maps.is_sampled[slot[met], slot_of_output[met, i], number[met]] = g.any(axis=0)
        numbers = number.reshape(-1, options)
        filters = (each.transpose(2, 0, 1).reshape(-1, options, n, n) for each in (P, Psi))
        maps.costs.record(FilterMoment(segments, step, after, numbers, *filters).only(np.flatnonzero(is_running)))
        has_next = is_running & (step < model.steps - 1)
        if has_next.any():
            P, Psi = _next_step(model, np.where(has_next, step, -1), options, P, Psi)
    maps.P0[:, :, number], maps.Psi[:, :, number] = P, Psi


def _next_step(model: LinearModel, step: np.ndarray, options: int, P: np.ndarray, Psi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return P and Psi (n, n, B) one step later; step (k,) of each segment, -1 where none is made."""
    is_made = step >= 0
    A = np.where(is_made[:, None, None], model.transition[step], np.eye(P.shape[0])).transpose(1, 2, 0)
    noise = np.where(is_made[:, None, None], model.noise[step], 0.0).transpose(1, 2, 0)
    A, noise = np.repeat(A, options, axis=2), np.repeat(noise, options, axis=2)
    return congruence(A, P) + noise, np.einsum("ijb,jkb->ikb", A, Psi)


def _sample(row: np.ndarray, P: np.ndarray, Psi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return row Psi over the innovation's standard deviation (n, B), and P and Psi after the sample, of row (n, B)."""
    v = np.einsum("ijb,jb->ib", P, row)
    deviation = np.sqrt(1 + np.einsum("ib,ib->b", row, v))
    gain, g = v / deviation, np.einsum("ib,ijb->jb", row, Psi) / deviation
    return g, P - gain[:, None] * gain, Psi - gain[:, None] * g
