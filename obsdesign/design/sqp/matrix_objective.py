"""Concave objectives of symmetric matrices and their local models: a smallest eigenvalue as a cone, all else by gradient and curvature."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from obsdesign.design.sqp.combination import AbstractCombination, Smallest


class AbstractMatrixObjective(ABC):
    """A number of information matrices (b, n, n): a combination of one number for each."""

    @property
    @abstractmethod
    def is_cone(self) -> bool:
        """Whether the number is the largest t with W - t E >= 0, `edge` being E."""

    @property
    @abstractmethod
    def combination(self) -> AbstractCombination:
        """How the numbers of the matrices make the one that is maximised."""

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
    return objective.combination.total(objective.values(matrices))


def initial_weights(objective: AbstractMatrixObjective, matrices: np.ndarray) -> np.ndarray:
    """Return weights (b,) of the matrices before a solver knows better: all on the worst, or the combination's slope."""
    return objective.combination.slope(objective.values(matrices))


def combination_curvature(objective: AbstractMatrixObjective, matrices: np.ndarray, derivatives: np.ndarray) -> np.ndarray | None:
    """Return what the bending of the combination adds to minus the second derivative (q, q), matrices moving by (b, q, n, n); None: 0."""
    curvature = objective.combination.curvature(objective.values(matrices))
    if curvature is None:
        return None
    slopes = np.einsum("bij,bqij->bq", objective.gradients(matrices), derivatives)
    return slopes.T @ curvature @ slopes


@dataclass(frozen=True, eq=False)
class LinearObjective(AbstractMatrixObjective):
    """<Z, W> for a given Z (n, n)."""

    Z: np.ndarray

    @property
    def is_cone(self) -> bool:
        """False: it is linear."""
        return False

    @property
    def combination(self) -> Smallest:
        """The smallest of the numbers."""
        return Smallest()

    def cone_matrix(self, n: int) -> np.ndarray:
        """Return 0: there is no cone."""
        return np.zeros((n, n))

    def values(self, matrices: np.ndarray) -> np.ndarray:
        """Return <Z, W> of every matrix."""
        return np.einsum("ij,bij->b", self.Z, matrices)

    def gradients(self, matrices: np.ndarray) -> np.ndarray:
        """Return Z for every matrix."""
        return np.broadcast_to(self.Z, matrices.shape)

    def curvatures(self, matrices: np.ndarray, derivatives: np.ndarray) -> np.ndarray:
        """Return 0: it does not bend."""
        return np.zeros((len(matrices), derivatives.shape[1], derivatives.shape[1]))

    def unit(self, matrices: np.ndarray) -> float:
        """Return the largest |<Z, W>|, 1 where all are 0."""
        return float(np.abs(self.values(matrices)).max()) or 1.0


def zero_objective(n: int) -> LinearObjective:
    """Return the objective 0, which leaves limits to be satisfied and prices to be low."""
    return LinearObjective(np.zeros((n, n)))
