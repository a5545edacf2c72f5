"""What a climb maximises, as a local model: a smallest eigenvalue as a cone, all else by slope and curvature."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from obsdesign.criteria._factor import elimination_matrix, schur_complement
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.design.problem import DesignProblem

_UNIT_SHARE = 1e-2  # share of the mean eigenvalue that counts as one unit where the smallest is next to nothing


class AbstractMatrixObjective(ABC):
    """A number of information matrices (b, n, n): the smallest of one number for each, or their mean."""

    @property
    @abstractmethod
    def is_cone(self) -> bool:
        """Whether the number is the largest t with W - t E >= 0, `edge` being E."""

    @property
    @abstractmethod
    def is_worst_case(self) -> bool:
        """Whether the smallest counts, not the mean."""

    @abstractmethod
    def cone_matrix(self, n: int) -> np.ndarray:
        """Return E (n, n)."""

    @abstractmethod
    def values(self, matrices: np.ndarray) -> np.ndarray:
        """Return the number (b,) of every matrix."""

    @abstractmethod
    def gradients(self, matrices: np.ndarray) -> np.ndarray:
        """Return Z (b, n, n): the number of each matrix grows by <Z, dW>."""

    @abstractmethod
    def curvatures(self, matrices: np.ndarray, derivatives: np.ndarray) -> np.ndarray:
        """Return (b, q, q) >= 0, minus the second derivative that bending adds, matrices moving by slopes (b, q, n, n)."""

    @abstractmethod
    def unit(self, matrices: np.ndarray) -> float:
        """Return what counts as 1 of the number, > 0, for a program that is well scaled."""


def evaluate_objective(objective: AbstractMatrixObjective, matrices: np.ndarray) -> float:
    """Return what is maximised, prices apart."""
    values = objective.values(matrices)
    return float(values.min() if objective.is_worst_case else values.mean())


def initial_weights(objective: AbstractMatrixObjective, matrices: np.ndarray) -> np.ndarray:
    """Return weights (b,) of the matrices before a solver knows better: all on the worst, or the same on all."""
    if not objective.is_worst_case:
        return np.full(len(matrices), 1 / len(matrices))
    return (np.arange(len(matrices)) == int(objective.values(matrices).argmin())).astype(float)


@dataclass(frozen=True, eq=False)
class CriterionObjective(AbstractMatrixObjective):
    """A criterion of the states that are judged (indices)."""

    criterion: AbstractCriterion
    state_indices: np.ndarray
    worst_case: bool

    @property
    def is_cone(self) -> bool:
        return self.criterion.is_smallest_eigenvalue

    @property
    def is_worst_case(self) -> bool:
        return self.worst_case

    def cone_matrix(self, n: int) -> np.ndarray:
        E = np.zeros((n, n))
        E[self.state_indices, self.state_indices] = 1.0
        return E

    def values(self, matrices: np.ndarray) -> np.ndarray:
        if self.is_cone and len(self.state_indices) == matrices.shape[-1]:
            return np.linalg.eigvalsh(matrices)[:, 0] if np.isfinite(matrices).all() else np.full(len(matrices), -np.inf)
        return np.array([self.criterion.value(schur_complement(W, self.state_indices)) for W in matrices])

    def gradients(self, matrices: np.ndarray) -> np.ndarray:
        gradients = np.empty_like(matrices)
        for i, W in enumerate(matrices):
            L = elimination_matrix(W, self.state_indices)
            gradients[i] = L @ self.criterion.slope(L.T @ W @ L) @ L.T
        return gradients

    def curvatures(self, matrices: np.ndarray, derivatives: np.ndarray) -> np.ndarray:
        eliminated = np.setdiff1d(np.arange(matrices.shape[-1]), self.state_indices)
        curvatures = []
        for W, D in zip(matrices, derivatives, strict=True):
            L = elimination_matrix(W, self.state_indices)
            V, DL = L.T @ W @ L, D @ L
            curvature = self.criterion.curvature(V, L.T @ DL)
            if eliminated.size:
                # d2 shadow = -2 L'D P W_bb^-1 P'D L
                cross, Z = DL[:, eliminated], self.criterion.slope(V)
                solution = np.linalg.solve(W[np.ix_(eliminated, eliminated)], cross)
                curvature = curvature + 2 * np.einsum("iak,kl,jal->ij", cross, Z, solution)
            curvatures.append(curvature)
        return np.array(curvatures)

    def unit(self, matrices: np.ndarray) -> float:
        value = evaluate_objective(self, matrices)
        if self.is_cone:
            # 1 where nothing is known at all: a unit next to 0 would make multipliers overflow
            return max(value, _UNIT_SHARE * float(np.mean(np.trace(matrices, axis1=1, axis2=2))) / matrices.shape[-1]) or 1.0
        return max(abs(value), np.finfo(float).tiny) if np.isfinite(value) and value and self.criterion.resolution == 0 else 1.0


@dataclass(frozen=True, eq=False)
class LinearObjective(AbstractMatrixObjective):
    """<Z, W> for a given Z (n, n)."""

    Z: np.ndarray

    @property
    def is_cone(self) -> bool:
        return False

    @property
    def is_worst_case(self) -> bool:
        return True

    def cone_matrix(self, n: int) -> np.ndarray:
        return np.zeros((n, n))

    def values(self, matrices: np.ndarray) -> np.ndarray:
        return np.einsum("ij,bij->b", self.Z, matrices)

    def gradients(self, matrices: np.ndarray) -> np.ndarray:
        return np.broadcast_to(self.Z, matrices.shape)

    def curvatures(self, matrices: np.ndarray, derivatives: np.ndarray) -> np.ndarray:
        return np.zeros((len(matrices), derivatives.shape[1], derivatives.shape[1]))

    def unit(self, matrices: np.ndarray) -> float:
        return float(np.abs(self.values(matrices)).max()) or 1.0


def zero_objective(n: int) -> LinearObjective:
    """Return the aim that leaves limits alone to be satisfied, and prices to be low."""
    return LinearObjective(np.zeros((n, n)))


def matrix_objective_of(problem: DesignProblem) -> CriterionObjective:
    """Return what a problem maximises."""
    return CriterionObjective(problem.criterion, problem.about_indices, problem.robust is None or problem.robust.worst)
