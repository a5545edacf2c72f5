"""What matters when: what each sensor in each segment is worth beside the rest of a schedule, and how long a choice is remembered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.selection.posterior.problem import PosteriorProblem, Walk
from obsdesign.selection.posterior.questions import FilterQuestion
from obsdesign.selection.posterior.segment_maps import segment_maps

_FORGOTTEN = 1e-3  # of what a choice changes at first, and of the covariance: what is less is forgotten


@dataclass(frozen=True, eq=False)
class SensorPrices:
    """prices (K, S): the cost without a sensor less that with it, all else as chosen; memory: segments until half of that is forgotten.

    NaN where there was no time for them.
    """

    prices: np.ndarray
    memory: float

    @property
    def notes(self) -> tuple[str, ...]:
        """What is missing, in words."""
        return ("time was up: what each sensor is worth was not computed",) if np.isnan(self.memory) else ()


@dataclass(frozen=True, eq=False)
class _Changes:
    """Schedules that differ from a walk in one sensor of an earlier segment.

    number (B,) of the change, P (n, n, B) now, first (B,): the trace of what it changed in P at the end of its segment, scaled; share
    (B,): the same over the covariance A of the walk, tr A^-1 |P - A|, at most 1. With (1 - t) A <= P <= (1 + t) A that stays so.
    """

    number: np.ndarray
    P: np.ndarray
    first: np.ndarray
    share: np.ndarray

    def only(self, index: np.ndarray) -> _Changes:
        """Return some of them."""
        return _Changes(self.number[index], self.P[:, :, index], self.first[index], self.share[index])


def sensor_prices(question: FilterQuestion, problem: PosteriorProblem, walk: Walk) -> SensorPrices:
    """Return what each sensor in each segment is worth, and the memory; each change is followed until it is forgotten."""
    if problem.deadline.is_over:
        return _no_prices(question)
    chosen = problem.options.chosen(walk.nodes)
    K, S = chosen.shape
    changed = chosen[:, None, :] ^ np.eye(S, dtype=bool)
    maps = segment_maps(question.linear_model, question.nodes, changed, question.costs)
    n, sensors = len(problem.P0), np.arange(S)
    states = np.arange(question.path.x.shape[1])
    weight = np.zeros(n)
    weight[states] = 1 / question.prior.std**2
    cost, half = np.full((K, K * S), np.nan) if problem.is_worst else np.zeros(K * S), np.full(K * S, np.inf)
    followed = _Changes(np.zeros(0, dtype=int), np.zeros((n, n, 0)), np.zeros(0), np.zeros(0))
    for k in range(K):
        if problem.deadline.is_over:
            return _no_prices(question)
        after = (
            walk.covariances[k + 1]
            if k + 1 < K
            else problem.maps.advance(k, problem.options.pattern_of_node[walk.nodes[[k]]], walk.covariances[k][:, :, None])[1][:, :, 0]
        )
        option = np.full(len(followed.number), problem.options.pattern_of_node[walk.nodes[k]])
        later_cost, later_P = problem.maps.advance(k, option, followed.P)
        first_cost, first_P = maps.advance(k, sensors, np.repeat(walk.covariances[k][:, :, None], S, axis=2))
        number = np.concatenate([followed.number, k * S + sensors])
        costs, P = np.concatenate([later_cost, first_cost]), np.concatenate([later_P, first_P], axis=2)
        if problem.is_worst:
            cost[k, number] = costs
        else:
            cost[number] += costs - walk.costs[k]
        size = np.abs(weight @ np.diagonal(P - after[:, :, None]).T)
        first = np.concatenate([followed.first, size[len(followed.first) :]])
        is_half = (size <= first / 2) & np.isinf(half[number]) & (number // S < k)
        half[number[is_half]] = k - number[is_half] // S
        present = _shares(after, P)
        share = np.concatenate([followed.share, np.minimum(present[len(followed.share) :], 1.0)])
        followed = _Changes(number, P, first, share).only(np.flatnonzero((present > _FORGOTTEN * share) | (size > first / 2)))
    if problem.is_worst:
        cost = np.fmax(np.where(np.isnan(cost), walk.costs[:, None], cost).max(axis=0), -np.inf) - walk.costs.max()
    sign = np.where(chosen, 1.0, -1.0)
    return SensorPrices(sign * cost.reshape(K, S), _median_of(half.reshape(K, S)[chosen & question.answers]))


def _shares(A: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return |tr A^-1 (P_b - A)| (B,) of P (n, n, B), at least the largest share by which a variance changes; inf without numbers."""
    if not np.isfinite(A).all():
        return np.full(P.shape[2], np.inf)
    size = np.sqrt(np.diag(A))
    size = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv(A / size[:, None] / size, rcond=1e-15, hermitian=True)
    changes = (P - A[:, :, None]) / size[:, None, None] / size[:, None]
    return np.abs(np.tensordot(inverse, changes, axes=2))


def _no_prices(question: FilterQuestion) -> SensorPrices:
    return SensorPrices(np.full(question.answers.shape, np.nan), float("nan"))


def _median_of(half: np.ndarray) -> float:
    """Return the median number of segments; inf where most changes are remembered to the end."""
    return float(np.median(half)) if len(half) else float("inf")
