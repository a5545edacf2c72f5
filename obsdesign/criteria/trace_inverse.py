"""The mean variance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.criteria._factor import inverse
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.round_off import spectrum

if TYPE_CHECKING:
    import cvxpy as cp


@dataclass(frozen=True)
class TraceInverse(AbstractCriterion):
    """-tr W^-1: minus the sum of the Cramer-Rao variances.

    Slope d(-tr W^-1) / dW = W^-2; -inf where W is singular. Called A-optimality in the design of experiments.
    """

    @property
    def label(self) -> str:
        """−tr of the inverse of S W S."""
        return "−tr (S W S)⁻¹"

    @property
    def symbol(self) -> str:
        """The label."""
        return self.label

    @property
    def knowledge(self) -> None:
        """None: W is the samples' information about x(t_0)."""
        return None

    def value(self, W: np.ndarray) -> float:
        """Return -tr W^-1, by unit sizes of the states; -inf where W is singular."""
        eigenvalues = spectrum(W)
        return (
            -np.inf
            if eigenvalues.is_singular
            else -float(np.sum((eigenvalues.V**2 @ (1 / eigenvalues.values)) / eigenvalues.unit_sizes**2))
        )

    def value_from_root(self, R: np.ndarray) -> np.ndarray:
        """Return -sum_ij R_ij^2."""
        return -np.sum(R**2, axis=(-2, -1))

    def covariance_cost(self, P: np.ndarray) -> np.ndarray:
        """Return tr P."""
        return np.trace(P, axis1=-2, axis2=-1)

    def covariance_cost_of_root(self, B: np.ndarray) -> np.ndarray:
        """Return the sum of squares of its entries."""
        return np.sum(B**2, axis=(-2, -1))

    @property
    def is_trace_of_covariance(self) -> bool:
        """True."""
        return True

    def slope(self, W: np.ndarray) -> np.ndarray:
        """Return W^-2."""
        V = inverse(W)
        return V @ V

    @property
    def resolution(self) -> float:
        """0: it scales with 1 / W."""
        return 0.0

    @property
    def scales_with_information(self) -> bool:
        """True: value(c W) = value(W) / c."""
        return True

    @property
    def is_smallest_eigenvalue(self) -> bool:
        """False: it has derivatives wherever W > 0."""
        return False

    def curvature(self, W: np.ndarray, D: np.ndarray) -> np.ndarray:
        """Return 2 tr(V D_i V D_j V) with V = W^-1."""
        # 2 tr(V D_i V D_j V) with V = W^-1
        V = inverse(W)
        return 2 * np.einsum("iab,jba->ij", V @ D @ V, V @ D)

    def atom(self, W: cp.Expression) -> cp.Expression:
        """Return -tr_inv(W)."""
        import cvxpy as cp

        return -cp.tr_inv(W)
