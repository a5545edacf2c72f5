"""The volume of the confidence ellipsoid."""

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
class LogDet(AbstractCriterion):
    """log det W: minus twice the log volume of the confidence ellipsoid, up to a constant.

    Slope d log det W / dW = W^-1; -inf where W is singular. Called D-optimality in the design of experiments.
    """

    @property
    def label(self) -> str:
        return "log det"

    @property
    def symbol(self) -> str:
        return self.label

    @property
    def knowledge(self) -> None:
        return None

    def value(self, W: np.ndarray) -> float:
        eigenvalues = spectrum(W)
        return (
            -np.inf if eigenvalues.is_singular else float(np.sum(np.log(eigenvalues.values)) + 2 * np.sum(np.log(eigenvalues.unit_sizes)))
        )

    def value_from_root(self, R: np.ndarray) -> np.ndarray:
        size = np.linalg.norm(R, axis=-1)
        return -2 * (np.linalg.slogdet(R / size[..., None])[1] + np.log(size).sum(axis=-1))

    def slope(self, W: np.ndarray) -> np.ndarray:
        return inverse(W)

    @property
    def resolution(self) -> float:
        return 1e-6

    @property
    def scales_with_information(self) -> bool:
        return False

    @property
    def is_smallest_eigenvalue(self) -> bool:
        return False

    def curvature(self, W: np.ndarray, D: np.ndarray) -> np.ndarray:
        scaled = inverse(W) @ D
        return np.einsum("iab,jba->ij", scaled, scaled)

    def atom(self, W: cp.Expression) -> cp.Expression:
        import cvxpy as cp

        return cp.log_det(W)
