"""The weakest direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.round_off import smallest_eigenvalue

if TYPE_CHECKING:
    import cvxpy as cp

_TIE = 1e-12  # eigenvalues nearer than this share of the largest are one


@dataclass(frozen=True)
class MinEigenvalue(AbstractCriterion):
    """lambda_min(W): information about the direction known least; 0 where that is round-off of what was added.

    In a design: max t subject to W - t I >= 0, without a slope where eigenvalues coincide. Called E-optimality in the design of
    experiments. Source: Brace and Morgansen, who maximise it.
    """

    @property
    def label(self) -> str:
        """λmin."""
        return "λmin"

    @property
    def symbol(self) -> str:
        """The label in Matplotlib's TeX."""
        return r"$\lambda_{min}$"

    @property
    def knowledge(self) -> None:
        """None: W is the samples' information about x(t_0)."""
        return None

    def value(self, W: np.ndarray) -> float:
        """Return lambda_min(W), 0 where it is round-off."""
        return smallest_eigenvalue(W)

    def value_from_root(self, R: np.ndarray) -> np.ndarray:
        """Return 1 / |R|^2, with the spectral norm."""
        return np.linalg.norm(R, ord=2, axis=(-2, -1)) ** -2.0

    def covariance_cost(self, P: np.ndarray) -> np.ndarray:
        """Return the largest eigenvalue, the variance of the direction known least."""
        return np.linalg.eigvalsh(P)[..., -1]

    def covariance_cost_of_root(self, B: np.ndarray) -> np.ndarray:
        """Return the square of the largest singular value."""
        return np.linalg.norm(B, 2, axis=(-2, -1)) ** 2

    @property
    def is_trace_of_covariance(self) -> bool:
        """False: it is the largest eigenvalue."""
        return False

    def slope(self, W: np.ndarray) -> np.ndarray:
        """Return V V' / k, V (n, k) the eigenvectors of the smallest eigenvalue, repeated k times: one of the supergradients."""
        # the mean over the eigenvectors of a repeated eigenvalue: one supergradient, and no matter how they are chosen
        values, vectors = np.linalg.eigh(W)
        lowest = vectors[:, values <= values[0] + _TIE * abs(values[-1])]
        return lowest @ lowest.T / lowest.shape[1]

    @property
    def resolution(self) -> float:
        """0: it scales with W."""
        return 0.0

    @property
    def scales_with_information(self) -> bool:
        """True: value(c W) = c value(W)."""
        return True

    @property
    def is_smallest_eigenvalue(self) -> bool:
        """True: a design maximises t under W - t I >= 0."""
        return True

    def curvature(self, W: np.ndarray, D: np.ndarray) -> np.ndarray:
        """Return zeros: where the eigenvalue is simple its model is the cone, not a parabola."""
        return np.zeros((len(D), len(D)))

    def atom(self, W: cp.Expression) -> cp.Expression:
        """Return lambda_min(W)."""
        import cvxpy as cp

        return cp.lambda_min(W)
