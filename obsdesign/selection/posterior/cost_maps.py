"""What the instants of segments cost, as functions of X = (P^-1 + O)^-1; see `segment_maps`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from obsdesign.selection.posterior.batches import congruence
from obsdesign.selection.posterior.instant_costs import CovarianceCost, InstantCosts


@dataclass(frozen=True, eq=False)
class Timetable:
    """When segments have samples and instants that cost something.

    starts, lengths (K,): first step and number of steps; samples_until (K, longest): how many instants with samples there are up to and
    with a step; instants (K,): how many in all; cost_slot (K, longest): which one of the instants that cost something since the last
    samples a step is, -1 = it costs nothing; cost_slots: how many such instants there are at most.
    """

    starts: np.ndarray
    lengths: np.ndarray
    samples_until: np.ndarray
    instants: np.ndarray
    cost_slot: np.ndarray
    cost_slots: int


def timetable_of(is_sampled: np.ndarray, has_cost: np.ndarray, nodes: np.ndarray) -> Timetable:
    """Return the timetable of steps (N,) with samples, and with costs, in the segments between nodes (K+1,)."""
    lengths = np.diff(nodes)
    steps = nodes[:-1, None] + np.arange(lengths.max())
    is_inside = steps < nodes[1:, None]
    steps = np.where(is_inside, steps, 0)
    samples_until = np.cumsum(is_inside & is_sampled[steps], axis=1)
    costs = is_inside & has_cost[steps]
    counted = np.cumsum(costs, axis=1)
    is_new = np.diff(samples_until, axis=1, prepend=0) > 0
    before_new = np.maximum.accumulate(np.where(is_new, counted - costs, 0), axis=1)
    slot = np.where(costs, counted - 1 - before_new, -1)
    return Timetable(nodes[:-1], lengths, samples_until, samples_until[:, -1], slot, int(slot.max(initial=-1)) + 1)


@dataclass(frozen=True, eq=False)
class FilterMoment:
    """Filters from P = 0 in k segments at once, after the samples at one of their steps, under O options.

    segments, step, after (k,): which segment, the step of the path, and how many instants with samples it has had; numbers (k, O) of the
    maps; P, Psi (k, O, n, n).
    """

    segments: np.ndarray
    step: np.ndarray
    after: np.ndarray
    numbers: np.ndarray
    P: np.ndarray
    Psi: np.ndarray

    def only(self, index: np.ndarray) -> FilterMoment:
        """Return some of the segments."""
        return FilterMoment(self.segments[index], self.step[index], self.after[index], self.numbers[index], self.P[index], self.Psi[index])


class AbstractCostMaps(ABC):
    """Costs of the instants of M segments under an option, (B,) or several at once (I, B). Leaves are final."""

    @property
    @abstractmethod
    def nothing(self) -> float:
        """The cost of a segment that does not count."""

    @abstractmethod
    def before_samples(self, number: np.ndarray, P: np.ndarray) -> np.ndarray:
        """Return what the instants before the first samples cost (..., B), and what does not depend on P."""

    @abstractmethod
    def add(self, cost: np.ndarray, t: int, number: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return the cost (..., B) together with that of the instants after the samples at the t-th instant, X (n, n, B) with these."""

    @abstractmethod
    def record(self, moment: FilterMoment) -> None:
        """Write down what an instant costs."""


@dataclass(frozen=True, eq=False)
class LinearCostMaps(AbstractCostMaps):
    """base + sum_t <M_t, X_t>: M (T + 1, d, M) by the lower triangle, off the diagonal twice; base (M,)."""

    costs: InstantCosts
    base: np.ndarray
    M: np.ndarray
    rows: np.ndarray
    columns: np.ndarray

    @property
    def nothing(self) -> float:
        """0."""
        return 0.0

    def before_samples(self, number: np.ndarray, P: np.ndarray) -> np.ndarray:
        """Return base + <M_0, P>."""
        return self.add(self.base[number], 0, number, P)

    def add(self, cost: np.ndarray, t: int, number: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return cost + <M_t, X>."""
        return cost + np.einsum("db,db->b", self.M[t].take(number, axis=1), X[self.rows, self.columns])

    def record(self, moment: FilterMoment) -> None:
        """Add weight Psi' W Psi to M, and weight tr(W P) to base."""
        counted = moment.only(np.flatnonzero(self.costs.weights[moment.step]))
        weights = self.costs.weights[counted.step]
        selected = counted.Psi[:, :, self.costs.about] / self.costs.scale[:, None]
        square = weights[:, None, None, None] * (selected.swapaxes(-1, -2) @ selected)
        twice = np.where(self.rows == self.columns, 1.0, 2.0)
        self.M[counted.after[:, None], :, counted.numbers] += twice * square[..., self.rows, self.columns]
        variances = np.diagonal(counted.P, axis1=2, axis2=3)[..., self.costs.about]
        self.base[counted.numbers] += weights[:, None] * (variances @ (1 / self.costs.scale**2))


@dataclass(frozen=True, eq=False)
class InstantCostMaps(AbstractCostMaps):
    """weight times the criterion of P0 + Psi X Psi', instant by instant: the sum, or the largest.

    weight (T + 1, I, M), Psi (T + 1, I, q, n, M), P0 (T + 1, I, q, q, M) of the states asked about, scaled: I instants at most since
    the last samples, weight 0 where there are fewer.
    """

    costs: InstantCosts
    cost_slot: np.ndarray
    first_steps: np.ndarray
    weight: np.ndarray
    Psi: np.ndarray
    P0: np.ndarray

    @property
    def criterion(self) -> CovarianceCost:
        """What an instant costs."""
        return self.costs.criterion

    @property
    def nothing(self) -> float:
        """0, or where the largest counts -inf."""
        return -np.inf if self.costs.is_worst else 0.0

    def before_samples(self, number: np.ndarray, P: np.ndarray) -> np.ndarray:
        """Return the cost of the instants before the first samples."""
        return self.add(np.full(len(number), self.nothing), 0, number, P)

    def add(self, cost: np.ndarray, t: int, number: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return the cost with that of the instants with X."""
        for weight, Psi, P0 in zip(self.weight[t], self.Psi[t], self.P0[t], strict=True):
            here = np.flatnonzero(weight[number])
            if len(here):
                part = number[here]
                covariance = P0[:, :, part] + congruence(Psi[:, :, part], X[:, :, here])
                instant = weight[part] * self.criterion.covariance_cost(covariance.transpose(2, 0, 1))
                cost[here] = np.maximum(cost[here], instant) if self.costs.is_worst else cost[here] + instant
        return cost

    def record(self, moment: FilterMoment) -> None:
        """Write the instant down."""
        counted, about, scale = moment.only(np.flatnonzero(self.costs.weights[moment.step])), self.costs.about, self.costs.scale
        slot = self.cost_slot[counted.segments, counted.step - self.first_steps[counted.segments]]
        place = counted.after[:, None], slot[:, None]
        self.weight[*place, counted.numbers] = self.costs.weights[counted.step][:, None]
        self.Psi[*place, :, :, counted.numbers] = counted.Psi[:, :, about] / scale[:, None]
        self.P0[*place, :, :, counted.numbers] = counted.P[:, :, about][..., about] / scale[:, None] / scale


@dataclass(frozen=True, eq=False)
class SeveralCostMaps(AbstractCostMaps):
    """Several costs of the same instants at once, (I, B)."""

    parts: tuple[AbstractCostMaps, ...]

    @property
    def nothing(self) -> float:
        """What all of them call nothing."""
        return self.parts[0].nothing

    def before_samples(self, number: np.ndarray, P: np.ndarray) -> np.ndarray:
        """Return the costs (I, B) of the instants before the first samples."""
        return np.array([part.before_samples(number, P) for part in self.parts])

    def add(self, cost: np.ndarray, t: int, number: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Return the costs (I, B) with those of the instants with X."""
        return np.array([part.add(row, t, number, X) for part, row in zip(self.parts, cost, strict=True)])

    def record(self, moment: FilterMoment) -> None:
        """Write the instant down for all."""
        for part in self.parts:
            part.record(moment)


def empty_cost_maps(costs: InstantCosts | tuple[InstantCosts, ...], timetable: Timetable, n: int, options: int) -> AbstractCostMaps:
    """Return the maps of the costs of all segments, to be filled."""
    if isinstance(costs, tuple):
        return SeveralCostMaps(tuple(empty_cost_maps(part, timetable, n, options) for part in costs))
    M, T = len(timetable.starts) * options, int(timetable.instants.max(initial=0))
    if costs.is_linear:
        rows, columns = np.tril_indices(n)
        return LinearCostMaps(costs, np.zeros(M), np.zeros((T + 1, len(rows), M)), rows, columns)
    slots, q = timetable.cost_slots, len(costs.about)
    return InstantCostMaps(
        costs,
        timetable.cost_slot,
        timetable.starts,
        np.zeros((T + 1, slots, M)),
        np.zeros((T + 1, slots, q, n, M)),
        np.zeros((T + 1, slots, q, q, M)),
    )
