"""What an instant costs: the criterion of the scaled covariance of the states asked about, and how instants are put together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.criteria.abstract import AbstractCriterion


@dataclass(frozen=True, eq=False)
class InstantCosts:
    """sum_k weight_k cost(P_k), or the largest of those with a weight where is_worst; cost: the criterion of D P D.

    weights (N,) >= 0; D = diag(1 / scale) on the states `about` (q,), the rest left out.
    """

    criterion: AbstractCriterion
    about: np.ndarray
    scale: np.ndarray
    weights: np.ndarray
    is_worst: bool

    @property
    def is_linear(self) -> bool:
        """Whether the cost is a sum that is linear in each covariance."""
        return self.criterion.is_trace_of_covariance and not self.is_worst

    def value(self, covariances: np.ndarray) -> float:
        """Return the cost of covariances (N, n, n)."""
        instants = np.flatnonzero(self.weights)
        block = covariances[np.ix_(instants, self.about, self.about)] / self.scale[:, None] / self.scale
        costs = self.criterion.covariance_cost(block)
        return float(costs.max()) if self.is_worst else float(self.weights[instants] @ costs)
