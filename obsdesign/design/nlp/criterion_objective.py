"""A criterion of the judged states as the solver's objective."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.criteria._factor import elimination_matrix, schur_complement
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.design.instants import instants_of
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.combination import AbstractCombination, Mean, Smallest
from obsdesign.design.sqp.matrix_objective import AbstractMatrixObjective, evaluate_objective

_UNIT_SHARE = 1e-2  # share of the mean eigenvalue that counts as one unit where the smallest is next to nothing


@dataclass(frozen=True, eq=False)
class CriterionObjective(AbstractMatrixObjective):
    """A criterion of the states that are judged (indices), of several matrices combined."""

    criterion: AbstractCriterion
    state_indices: np.ndarray
    matrix_combination: AbstractCombination

    @property
    def is_cone(self) -> bool:
        """Whether the criterion is the smallest eigenvalue: maximise t under W - t E >= 0."""
        return self.criterion.is_smallest_eigenvalue

    @property
    def combination(self) -> AbstractCombination:
        """How draws, or instants, make one number."""
        return self.matrix_combination

    def cone_matrix(self, n: int) -> np.ndarray:
        """Return E = diag(1 for the states that are judged, 0 for the others)."""
        E = np.zeros((n, n))
        E[self.state_indices, self.state_indices] = 1.0
        return E

    def values(self, matrices: np.ndarray) -> np.ndarray:
        """Return criterion(W_aa - W_ab W_bb^-1 W_ba), a the states that are judged, b the others."""
        if self.is_cone and len(self.state_indices) == matrices.shape[-1]:
            return np.linalg.eigvalsh(matrices)[:, 0] if np.isfinite(matrices).all() else np.full(len(matrices), -np.inf)
        return np.array([self.criterion.value(schur_complement(W, self.state_indices)) for W in matrices])

    def gradients(self, matrices: np.ndarray) -> np.ndarray:
        """Return L Z L', Z the slope of the criterion at L'W L, L = (1; -W_bb^-1 W_ba)."""
        gradients = np.empty_like(matrices)
        for i, W in enumerate(matrices):
            L = elimination_matrix(W, self.state_indices)
            gradients[i] = L @ self.criterion.slope(L.T @ W @ L) @ L.T
        return gradients

    def curvatures(self, matrices: np.ndarray, derivatives: np.ndarray) -> np.ndarray:
        """Return the criterion's curvature along L'D L, and 2 <Z, L'D P W_bb^-1 P'D L> of the Schur complement, P the columns of b."""
        eliminated = np.setdiff1d(np.arange(matrices.shape[-1]), self.state_indices)
        curvatures = []
        for W, D in zip(matrices, derivatives, strict=True):
            L = elimination_matrix(W, self.state_indices)
            V, DL = L.T @ W @ L, D @ L
            curvature = self.criterion.curvature(V, L.T @ DL)
            if eliminated.size:
                # d2 of the Schur complement = -2 L'D P W_bb^-1 P'D L
                cross, Z = DL[:, eliminated], self.criterion.slope(V)
                solution = np.linalg.solve(W[np.ix_(eliminated, eliminated)], cross)
                curvature = curvature + 2 * np.einsum("iak,kl,jal->ij", cross, Z, solution)
            curvatures.append(curvature)
        return np.array(curvatures)

    def unit(self, matrices: np.ndarray) -> float:
        """Return the value's size; for a cone no less than a share of the mean trace; 1 where differences count."""
        value = evaluate_objective(self, matrices)
        if self.is_cone:
            # 1 where nothing is known at all: a unit next to 0 would make multipliers overflow
            return max(value, _UNIT_SHARE * float(np.mean(np.trace(matrices, axis1=1, axis2=2))) / matrices.shape[-1]) or 1.0
        return max(abs(value), np.finfo(float).tiny) if np.isfinite(value) and value and self.criterion.resolution == 0 else 1.0


def matrix_objective_of(problem: DesignProblem) -> CriterionObjective:
    """Return what a problem maximises: of one path at one instant or several, or of several draws."""
    instants = instants_of(problem.criterion, problem.steps)
    of_draws = Smallest() if problem.robust is None or problem.robust.worst else Mean()
    return CriterionObjective(problem.criterion, problem.about_indices, of_draws if instants is None else instants.combination)
