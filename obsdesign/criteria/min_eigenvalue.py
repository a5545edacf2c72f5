"""The weakest direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.criteria import _factor as factor
from obsdesign.criteria.abstract import AbstractCriterion, Lift

if TYPE_CHECKING:
    import casadi as ca
    import cvxpy as cp

_TIE = 1e-12  # eigenvalues nearer than this share of the largest are one


@dataclass(frozen=True)
class MinEigenvalue(AbstractCriterion):
    """lambda_min(W): information about the direction known least.

    Lift: max c t subject to W / c - t I = L L', L lower triangular; smooth where eigenvalues coincide.
    """

    @property
    def knowledge(self) -> None:
        return None

    def value(self, W: np.ndarray) -> float:
        return float(np.linalg.eigvalsh(W)[0])

    def slope(self, W: np.ndarray) -> np.ndarray:
        # the mean over the eigenvectors of a repeated eigenvalue: one supergradient, and no matter how they are chosen
        values, vectors = np.linalg.eigh(W)
        lowest = vectors[:, values <= values[0] + _TIE * abs(values[-1])]
        return lowest @ lowest.T / lowest.shape[1]

    @property
    def resolution(self) -> float:
        return 0.0

    def lift(self, W: ca.SX, c: ca.SX) -> Lift:
        import casadi as ca

        n = W.shape[0]
        t, L = ca.SX.sym("t"), factor.lower_triangular("L", n)
        return Lift(
            objective=t * c,
            variables=ca.vertcat(t, factor.entries(L)),
            equalities=factor.lower_entries(W / c - t * ca.SX.eye(n) - L @ L.T),
            lower=np.concatenate([[-np.inf], factor.diagonal_at_least(n, 0.0)]),
            start=_start,
        )

    def atom(self, W: cp.Expression) -> cp.Expression:
        import cvxpy as cp

        return cp.lambda_min(W)


def _start(W: np.ndarray, c: float) -> np.ndarray:
    # a little below the eigenvalue, so that L is not singular
    t = 0.9 * float(np.linalg.eigvalsh(W / c)[0])
    return np.concatenate([[t], factor.entries_of(factor.nearest_factor(W / c - t * np.eye(len(W))))])
