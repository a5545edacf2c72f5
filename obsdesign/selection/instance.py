"""A selection problem in the form that every method works on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.rules.abstract import Resource
from obsdesign.selection.duals import Dual
from obsdesign.selection.feasible import AbstractSchedules


@dataclass(frozen=True, eq=False)
class Instance:
    """max min_r criterion(sum_ks kept_rs on_ks W_ks) - switching over the schedules that keep every rule.

    rows (K, S, d): blocks as vectors, d = n (n + 1) / 2, off the diagonal times sqrt 2, so that <W, Z> is a product of vectors.
    kept (R, S): which sensors work in each of the R scenarios of loss; a row of ones where none is lost. switching (S,).
    """

    rows: np.ndarray
    n: int
    criterion: AbstractCriterion
    schedules: AbstractSchedules
    resources: tuple[Resource, ...]
    switching: np.ndarray
    kept: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        """(K, S)."""
        return self.rows.shape[0], self.rows.shape[1]

    @cached_property
    def limits(self) -> np.ndarray:
        """Limits of the resources."""
        return np.array([resource.limit for resource in self.resources])

    @cached_property
    def rounding(self) -> float:
        """What an eigenvalue of 0 may come out as."""
        everything = self.information(self.schedules.available)
        return 4 * self.n * np.finfo(float).eps * float(np.abs(everything).max())

    def information(self, chosen: np.ndarray) -> np.ndarray:
        """W (R, n, n) in each scenario of loss."""
        if len(self.kept) == 1:  # in one piece, which is faster
            return matrices((chosen * self.kept[0]).ravel() @ self.rows.reshape(chosen.size, -1), self.n)[None]
        by_sensor = np.stack([chosen[:, s].astype(float) @ self.rows[:, s] for s in range(self.shape[1])])
        return matrices(self.kept @ by_sensor, self.n)

    def usage(self, chosen: np.ndarray) -> np.ndarray:
        """How much of every resource a schedule takes."""
        starts = started(chosen).sum(axis=0)
        return np.array([float(resource.usage[chosen].sum() + resource.start @ starts) for resource in self.resources])

    def penalty(self, chosen: np.ndarray) -> float:
        """What switching takes off the value."""
        return float(self.switching @ started(chosen).sum(axis=0)) if self.switching.any() else 0.0

    def value(self, chosen: np.ndarray) -> float:
        """What a schedule is worth."""
        return self.judged(self.information(chosen)) - self.penalty(chosen)

    def judged(self, W: np.ndarray) -> float:
        """min_r criterion(W_r)."""
        return min(self.criterion.value(each) for each in W)

    def keeps_limits(self, chosen: np.ndarray) -> bool:
        """Whether no resource is exceeded, but for rounding."""
        return bool((self.usage(chosen) <= self.limits + 1e-9 * np.maximum(1.0, self.limits)).all())

    def prices(self, dual: Dual) -> tuple[np.ndarray, np.ndarray]:
        """What each sensor in each segment (K, S) is worth, and what each switching-on (S,) costs."""
        K, S = self.shape
        z = self.kept.T @ vectors(dual.Z)
        if len(self.kept) == 1:  # in one piece, which is faster
            price = (self.rows.reshape(K * S, -1) @ vectors(dual.Z[0])).reshape(K, S) * self.kept[0]
        else:
            price = np.stack([self.rows[:, s] @ z[s] for s in range(S)], axis=1)
        np.maximum(price, 0.0, out=price)  # information is worth at least nothing: what is negative is a rounding error
        start = self.switching.copy()
        for mu, resource in zip(dual.mu, self.resources, strict=True):
            if mu > 0:
                price -= mu * resource.usage
                start += mu * resource.start
        return price, start

    def constant(self, dual: Dual) -> float:
        """What a bound has beside the best schedule's worth."""
        return dual.offset + float(dual.mu @ self.limits)


def started(chosen: np.ndarray) -> np.ndarray:
    """Where (K, S) a sensor is switched on; all are off before the first segment."""
    before = np.zeros_like(chosen)
    before[1:] = chosen[:-1]
    return chosen & ~before


def vectors(W: np.ndarray) -> np.ndarray:
    """Return symmetric matrices (..., n, n) as vectors (..., n (n + 1) / 2) with the same inner product."""
    rows, columns, weights = _triangle(W.shape[-1])
    return W[..., rows, columns] * weights


def matrices(values: np.ndarray, n: int) -> np.ndarray:
    """Return the symmetric matrices (..., n, n) of vectors."""
    rows, columns, weights = _triangle(n)
    W = np.empty((*values.shape[:-1], n, n))
    W[..., rows, columns] = W[..., columns, rows] = values / weights
    return W


@lru_cache(32)
def _triangle(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rows, columns = np.tril_indices(n)
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))
