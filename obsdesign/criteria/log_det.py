"""The volume of the confidence ellipsoid."""

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
class LogDet(AbstractCriterion):
    """log det W: minus twice the log volume of the confidence ellipsoid, up to a constant.

    Lift: W / c = L L', maximise 2 sum log L_ii + n log c.
    """

    @property
    def knowledge(self) -> None:
        return None

    def value(self, W: np.ndarray) -> float:
        found = factor.balanced(W)
        return -np.inf if found is None else float(np.sum(np.log(found.values)) + 2 * np.sum(np.log(found.d)))

    def slope(self, W: np.ndarray) -> np.ndarray:
        return np.linalg.inv(W)

    @property
    def resolution(self) -> float:
        return 1e-6

    def lift(self, W: ca.SX, c: ca.SX) -> Lift:
        import casadi as ca

        n = W.shape[0]
        L = factor.lower_triangular("L", n)
        return Lift(
            objective=2 * ca.sum1(ca.log(ca.diag(L))) + n * ca.log(c),
            variables=factor.entries(L),
            equalities=factor.lower_entries(W / c - L @ L.T),
            lower=factor.diagonal_at_least(n, 1e-9),  # the logarithm's domain is open
            start=_start,
        )

    def atom(self, W: cp.Expression) -> cp.Expression:
        import cvxpy as cp

        return cp.log_det(W)


def _start(W: np.ndarray, c: float) -> np.ndarray:
    return factor.entries_of(factor.nearest_factor(W / c))
