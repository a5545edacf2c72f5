"""Concave objectives of symmetric matrices and their local models: a smallest eigenvalue as a cone, all else by gradient and curvature."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np


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
class LinearObjective(AbstractMatrixObjective):
    """<Z, W> for a given Z (n, n)."""

    Z: np.ndarray

    @property
    def is_cone(self) -> bool:
        """False: it is linear."""
        return False

    @property
    def is_worst_case(self) -> bool:
        """True: the smallest of the numbers."""
        return True

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
