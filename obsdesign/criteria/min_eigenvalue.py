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
        return "λmin"

    @property
    def symbol(self) -> str:
        return r"$\lambda_{min}$"

    @property
    def knowledge(self) -> None:
        return None

    def value(self, W: np.ndarray) -> float:
        return smallest_eigenvalue(W)

    def value_from_root(self, R: np.ndarray) -> np.ndarray:
        return np.linalg.norm(R, ord=2, axis=(-2, -1)) ** -2.0

    def slope(self, W: np.ndarray) -> np.ndarray:
        # the mean over the eigenvectors of a repeated eigenvalue: one supergradient, and no matter how they are chosen
        values, vectors = np.linalg.eigh(W)
        lowest = vectors[:, values <= values[0] + _TIE * abs(values[-1])]
        return lowest @ lowest.T / lowest.shape[1]

    @property
    def resolution(self) -> float:
        return 0.0

    @property
    def scales_with_information(self) -> bool:
        return True

    @property
    def is_smallest_eigenvalue(self) -> bool:
        return True

    def curvature(self, W: np.ndarray, D: np.ndarray) -> np.ndarray:
        return np.zeros((len(D), len(D)))

    def atom(self, W: cp.Expression) -> cp.Expression:
        import cvxpy as cp

        return cp.lambda_min(W)
