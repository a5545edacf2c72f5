"""What an instant costs: the criterion of the scaled covariance of the states asked about, and how instants are put together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np


class CovarianceCost(Protocol):
    """What a covariance costs: a criterion, or whether it is above a limit."""

    def covariance_cost(self, P: np.ndarray) -> np.ndarray:
        """Return what covariances P (..., n, n) cost (...): no less where P is larger in Loewner's order."""
        ...

    def covariance_cost_of_root(self, B: np.ndarray) -> np.ndarray:
        """Return what P = B B' costs (...), B (..., n, m)."""
        ...

    @property
    def is_trace_of_covariance(self) -> bool:
        """Whether that cost is tr P."""
        ...

    @property
    def gap_kind(self) -> Literal["relative", "absolute"]:
        """How a value and its bound are compared."""
        ...


@dataclass(frozen=True)
class AboveLimit:
    """1 where tr P is above a limit, else 0: sums count the instants that break a requirement."""

    limit: float

    def covariance_cost(self, P: np.ndarray) -> np.ndarray:
        """Return 1 where tr P > limit, else 0 (...)."""
        return (np.trace(P, axis1=-2, axis2=-1) > self.limit).astype(float)

    def covariance_cost_of_root(self, B: np.ndarray) -> np.ndarray:
        """Return 1 where the sum of squares of B's entries is above the limit, else 0 (...)."""
        return (np.sum(B**2, axis=(-2, -1)) > self.limit).astype(float)

    @property
    def is_trace_of_covariance(self) -> bool:
        """False: it is no sum that is linear in covariances."""
        return False

    @property
    def gap_kind(self) -> Literal["relative", "absolute"]:
        """Absolute: it counts."""
        return "absolute"


@dataclass(frozen=True, eq=False)
class InstantCosts:
    """sum_k weight_k cost(P_k), or the largest of those with a weight where is_worst; cost: the criterion of D P D.

    weights (N,) >= 0; D = diag(1 / scale) on the states `about` (q,), the rest left out.
    """

    criterion: CovarianceCost
    about: np.ndarray
    scale: np.ndarray
    weights: np.ndarray
    is_worst: bool

    @property
    def is_linear(self) -> bool:
        """Whether the cost is a sum that is linear in each covariance."""
        return self.criterion.is_trace_of_covariance and not self.is_worst

    @property
    def counted(self) -> np.ndarray:
        """Numbers of the instants that have a weight (k,)."""
        return np.flatnonzero(self.weights)

    def each_from_roots(self, roots: np.ndarray) -> np.ndarray:
        """Return what each of the instants that have a weight adds (k,), from roots B (k, n, m) of their covariances B B'."""
        block = roots[:, self.about] / self.scale[:, None]
        return self.weights[self.counted] * self.criterion.covariance_cost_of_root(block)

    def each(self, covariances: np.ndarray) -> np.ndarray:
        """Return what each of the instants that have a weight adds (k,), of covariances (N, n, n)."""
        block = covariances[np.ix_(self.counted, self.about, self.about)] / self.scale[:, None] / self.scale
        return self.weights[self.counted] * self.criterion.covariance_cost(block)

    def together(self, each: np.ndarray) -> float:
        """Return the cost of instants that add (k,)."""
        return float(each.max()) if self.is_worst else float(each.sum())

    def by_segment(self, each: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """Return the cost (K,) of segments between nodes (K+1,) of which the instants that have a weight add (k,)."""
        costs = np.full(len(nodes) - 1, -np.inf if self.is_worst else 0.0)
        combine = np.maximum if self.is_worst else np.add
        combine.at(costs, np.searchsorted(nodes, self.counted, side="right") - 1, each)
        return costs
