"""The mean variance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.criteria import _factor as factor
from obsdesign.criteria.abstract import AbstractCriterion, Lift

if TYPE_CHECKING:
    import casadi as ca
    import cvxpy as cp


@dataclass(frozen=True)
class TraceInverse(AbstractCriterion):
    """-tr W^-1: minus the sum of the Cramer-Rao variances.

    Lift: W / c = L L', X L = I with X lower triangular, maximise -|X|_F^2 / c.
    """

    @property
    def knowledge(self) -> None:
        return None

    def value(self, W: np.ndarray) -> float:
        found = factor.balanced(W)
        return -np.inf if found is None else -float(np.sum((found.V**2 @ (1 / found.values)) / found.d**2))

    def slope(self, W: np.ndarray) -> np.ndarray:
        inverse = np.linalg.inv(W)
        return inverse @ inverse

    @property
    def resolution(self) -> float:
        return 0.0

    def lift(self, W: ca.SX, c: ca.SX) -> Lift:
        import casadi as ca

        n = W.shape[0]
        L, X = factor.lower_triangular("L", n), factor.lower_triangular("X", n)
        floor = factor.diagonal_at_least(n, 0.0)
        return Lift(
            objective=-ca.sumsqr(X) / c,
            variables=ca.vertcat(factor.entries(L), factor.entries(X)),
            equalities=ca.vertcat(factor.lower_entries(W / c - L @ L.T), factor.lower_entries(X @ L - ca.SX.eye(n))),
            lower=np.concatenate([floor, floor]),
            start=_start,
        )

    def atom(self, W: cp.Expression) -> cp.Expression:
        import cvxpy as cp

        return -cp.tr_inv(W)


def _start(W: np.ndarray, c: float) -> np.ndarray:
    L = factor.nearest_factor(W / c)
    return np.concatenate([factor.entries_of(L), factor.entries_of(np.linalg.inv(L))])
