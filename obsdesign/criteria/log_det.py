"""The volume of the confidence ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.criteria._factor import inverse
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.round_off import rotated_triangles, spectrum

if TYPE_CHECKING:
    import cvxpy as cp


@dataclass(frozen=True)
class LogDet(AbstractCriterion):
    """log det W: minus twice the log volume of the confidence ellipsoid, up to a constant.

    Slope d log det W / dW = W^-1; -inf where W is singular. Called D-optimality in the design of experiments.
    """

    @property
    def label(self) -> str:
        """log det."""
        return "log det"

    @property
    def symbol(self) -> str:
        """The label."""
        return self.label

    @property
    def knowledge(self) -> None:
        """None: W is the samples' information about x(t_0)."""
        return None

    def value(self, W: np.ndarray) -> float:
        """Return log det W, by unit sizes of the states; -inf where W is singular."""
        eigenvalues = spectrum(W)
        return (
            -np.inf if eigenvalues.is_singular else float(np.sum(np.log(eigenvalues.values)) + 2 * np.sum(np.log(eigenvalues.unit_sizes)))
        )

    def value_from_root(self, R: np.ndarray) -> np.ndarray:
        """Return -2 log |det R|, rows scaled to length 1 first."""
        size = np.linalg.norm(R, axis=-1)
        return -2 * (np.linalg.slogdet(R / size[..., None])[1] + np.log(size).sum(axis=-1))

    def covariance_cost(self, P: np.ndarray) -> np.ndarray:
        """Return log det P."""
        return np.linalg.slogdet(P)[1]

    def covariance_cost_of_root(self, B: np.ndarray) -> np.ndarray:
        """Return 2 log |det R|, R the triangular factor of B': its square has only half as many digits."""
        return -self.value_from_root(rotated_triangles(B.swapaxes(-1, -2)))

    @property
    def is_trace_of_covariance(self) -> bool:
        """False: it is log det P."""
        return False

    def slope(self, W: np.ndarray) -> np.ndarray:
        """Return W^-1."""
        return inverse(W)

    @property
    def resolution(self) -> float:
        """1e-6 nats: differences count."""
        return 1e-6

    @property
    def scales_with_information(self) -> bool:
        """False: value(c W) = value(W) + n log c."""
        return False

    @property
    def is_smallest_eigenvalue(self) -> bool:
        """False: it has derivatives wherever W > 0."""
        return False

    def curvature(self, W: np.ndarray, D: np.ndarray) -> np.ndarray:
        """Return tr(W^-1 D_i W^-1 D_j)."""
        scaled = inverse(W) @ D
        return np.einsum("iab,jba->ij", scaled, scaled)

    def atom(self, W: cp.Expression) -> cp.Expression:
        """Return log_det(W)."""
        import cvxpy as cp

        return cp.log_det(W)
