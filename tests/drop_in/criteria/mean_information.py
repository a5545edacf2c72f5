"""The mean over all directions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.criteria.abstract import AbstractCriterion

if TYPE_CHECKING:
    import cvxpy as cp


@dataclass(frozen=True)
class MeanInformation(AbstractCriterion):
    """tr W / n, which says nothing of what stays hidden. Called T-optimality in the design of experiments."""

    @property
    def label(self) -> str:
        return "mean eigenvalue"

    @property
    def symbol(self) -> str:
        return r"$\bar\lambda$"

    @property
    def knowledge(self) -> None:
        return None

    def value(self, W: np.ndarray) -> float:
        return float(np.trace(W)) / len(W)

    def value_from_root(self, R: np.ndarray) -> np.ndarray:
        return np.sum(np.linalg.inv(R) ** 2, axis=(-2, -1)) / R.shape[-1]

    def covariance_cost(self, P: np.ndarray) -> np.ndarray:
        return P.shape[-1] / np.trace(np.linalg.inv(P), axis1=-2, axis2=-1)

    def covariance_cost_of_root(self, B: np.ndarray) -> np.ndarray:
        return self.covariance_cost(B @ B.swapaxes(-1, -2))

    @property
    def is_trace_of_covariance(self) -> bool:
        return False

    def slope(self, W: np.ndarray) -> np.ndarray:
        return np.eye(len(W)) / len(W)

    @property
    def resolution(self) -> float:
        return 0.0

    @property
    def scales_with_information(self) -> bool:
        return True

    @property
    def is_smallest_eigenvalue(self) -> bool:
        return False

    def curvature(self, W: np.ndarray, D: np.ndarray) -> np.ndarray:
        return np.zeros((len(D), len(D)))

    def atom(self, W: cp.Expression) -> cp.Expression:
        import cvxpy as cp

        return cp.trace(W) / W.shape[0]
