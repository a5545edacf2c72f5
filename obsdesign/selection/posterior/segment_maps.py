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

_BATCH = 2048  # covariances at a time: what fits into a cache
_MAX_ENTRIES = 4_000_000  # numbers of one array while maps are computed: 32 MB


@dataclass(frozen=True, eq=False)
class SegmentMaps:
    """K segments under each of O options: option o of segment k is number k O + o of M = K O.

    rows (T, R, n, M): r of the samples at the T instants at most that a segment has samples at, R at most in one; 0 where there is
    none. instants (K,): how many there are. Psi, P0 (n, n, M). costs: what is added after each of them. Of a stretch of a run, first: the
    run's number of its first segment, free: how many segments at its beginning cost nothing.
    """

    options: int
    rows: np.ndarray
    instants: np.ndarray
    Psi: np.ndarray
    P0: np.ndarray
    costs: AbstractCostMaps
    first: int = 0
    free: int = 0

    def stretch(self, first: int, last: int, free: int) -> SegmentMaps:
        """Return the maps of segments first..last - 1, numbered anew from 0, of which the first `free` cost nothing."""
        return replace(self, instants=self.instants[first:last], first=self.first + first, free=free)

    def advance(self, segment: np.ndarray | int, option: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the costs (B,) of options (B,) in segments (B,) from covariances (n, n, B) before them, and those at their ends.

        Costs are (I, B) where there are several at once.
        """
        number = (segment + self.first) * self.options + option
        batches = [slice(first, first + _BATCH) for first in range(0, max(1, len(number)), _BATCH)]
        parts = [self._advance(number[batch], P[:, :, batch]) for batch in batches]
        cost, P_next = np.concatenate([cost for cost, _ in parts], axis=-1), np.concatenate([P_next for _, P_next in parts], axis=2)
        if self.free:
            cost[..., number // self.options < self.first + self.free] = self.costs.nothing
        return cost, P_next

    def _advance(self, number: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        X, cost = P, self.costs.before_samples(number, P)
        for t in range(int(self.instants[number // self.options - self.first].max(initial=0))):
            for rows in self.rows[t]:
                X = add_row(X, rows[:, number])
            cost = self.costs.add(cost, t + 1, number, X)
        return cost, self.P0[:, :, number] + congruence(self.Psi[:, :, number], X)


def segment_maps(
    model: LinearModel, nodes: np.ndarray, patterns: np.ndarray, costs: InstantCosts | tuple[InstantCosts, ...]
) -> SegmentMaps:
    """Return the maps of the segments between nodes (K+1,), counted in steps, under patterns (O, S) of sensors."""
    K, options, n = len(nodes) - 1, len(patterns), model.initial_covariance.shape[0]
    has_cost = np.any([part.weights > 0 for part in (costs if isinstance(costs, tuple) else (costs,))], axis=0)
    timetable = timetable_of(np.asarray(model.rows.any(axis=(1, 2))), has_cost, nodes)
    is_on = patterns[:, model.sensor_of_row]
    T, R = int(timetable.instants.max(initial=0)), max(1, int(is_on.sum(axis=1).max()))
    maps = SegmentMaps(
        options,
        np.zeros((T, R, n, K * options)),
        timetable.instants,
        np.zeros((n, n, K * options)),
        np.zeros((n, n, K * options)),
        empty_cost_maps(costs, timetable, n, options),
    )
    size = max(1, _MAX_ENTRIES // (options * n * n))
    for first in range(0, K, size):
        _fill(maps, model, timetable, np.arange(first, min(first + size, K)), is_on)
    return maps


def _fill(maps: SegmentMaps, model: LinearModel, timetable: Timetable, segments: np.ndarray, is_on: np.ndarray) -> None:
    """Run filters from P = 0 through some of the segments, all options at once, and write what they meet into the maps."""
    n, K, options = model.initial_covariance.shape[0], len(segments), maps.options
    slot_of_output = np.cumsum(is_on, axis=1) - 1
    P, Psi = np.zeros((K, options, n, n)), np.broadcast_to(np.eye(n), (K, options, n, n)).copy()
    numbers = segments[:, None] * options + np.arange(options)
    for t in range(int(timetable.lengths[segments].max())):
        is_running = t < timetable.lengths[segments]
        step = np.where(is_running, timetable.starts[segments] + t, 0)
        after = timetable.samples_until[segments, np.minimum(t, timetable.samples_until.shape[1] - 1)]
        for i in range(model.rows.shape[1]):
            row = np.where(is_running[:, None], model.rows[step, i], 0.0)
            if row.any():
                g, P, Psi = _sample(row[:, None, :] * is_on[None, :, i, None], P, Psi)
                k, o = np.nonzero(g.any(axis=2))
                maps.rows[after[k] - 1, slot_of_output[o, i], :, numbers[k, o]] = g[k, o]
        maps.costs.record(FilterMoment(segments, step, after, numbers, P, Psi).only(np.flatnonzero(is_running)))
        has_next = is_running & (step < model.steps - 1)
        if has_next.any():
            index = np.where(has_next, step, 0)
            A = np.where(has_next[:, None, None], model.transition[index], np.eye(n))[:, None]
            P, Psi = A @ P @ A.swapaxes(-1, -2) + np.where(has_next[:, None, None], model.noise[index], 0.0)[:, None], A @ Psi
    maps.P0[:, :, numbers.ravel()] = P.reshape(-1, n, n).transpose(1, 2, 0)
    maps.Psi[:, :, numbers.ravel()] = Psi.reshape(-1, n, n).transpose(1, 2, 0)


def _sample(row: np.ndarray, P: np.ndarray, Psi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return row Psi over the innovation's standard deviation, and P and Psi after the sample, of row (K, O, n)."""
    v = np.einsum("koij,koj->koi", P, row)
    deviation = np.sqrt(1 + np.einsum("koi,koi->ko", row, v))[..., None]
    gain, g = v / deviation, np.einsum("koi,koij->koj", row, Psi) / deviation
    return g, P - gain[..., None] * gain[..., None, :], Psi - gain[..., None] * g[..., None, :]
