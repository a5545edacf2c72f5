"""What a climb maximises, as a local model: a smallest eigenvalue as a cone, all else by slope and curvature."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from obsdesign.criteria._factor import shadow, shadow_lift
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.design.problem import DesignProblem

_LEAST = 1e-2  # share of the mean eigenvalue that counts as one unit where the smallest is next to nothing


class AbstractAim(ABC):
    """A number of information matrices (b, n, n): the smallest of one number for each, or their mean."""

    @property
    @abstractmethod
    def is_cone(self) -> bool:
        """Whether the number is the largest t with W - t E >= 0, `edge` being E."""

    @property
    @abstractmethod
    def worst(self) -> bool:
        """Whether the smallest counts, not the mean."""

    @abstractmethod
    def edge(self, n: int) -> np.ndarray:
        """Return E (n, n)."""

    @abstractmethod
    def each(self, matrices: np.ndarray) -> np.ndarray:
        """Return the number (b,) of every matrix."""

    @abstractmethod
    def slopes(self, matrices: np.ndarray) -> np.ndarray:
        """Return Z (b, n, n): the number of each matrix grows by <Z, dW>."""

    @abstractmethod
    def curvatures(self, matrices: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Return (b, q, q) >= 0, minus the second derivative that bending adds, matrices moving by slopes (b, q, n, n)."""

    @abstractmethod
    def unit(self, matrices: np.ndarray) -> float:
        """Return what counts as 1 of the number, > 0, for a program that is well scaled."""


def value_of(aim: AbstractAim, matrices: np.ndarray) -> float:
    """Return what is maximised, prices apart."""
    each = aim.each(matrices)
    return float(each.min() if aim.worst else each.mean())


def weights_of(aim: AbstractAim, matrices: np.ndarray) -> np.ndarray:
    """Return weights (b,) of the matrices before a solver knows better: all on the worst, or the same on all."""
    if not aim.worst:
        return np.full(len(matrices), 1 / len(matrices))
    return (np.arange(len(matrices)) == int(aim.each(matrices).argmin())).astype(float)


@dataclass(frozen=True, eq=False)
class Judged(AbstractAim):
    """A criterion of the states that are judged (indices)."""

    criterion: AbstractCriterion
    kept: np.ndarray
    of_worst: bool

    @property
    def is_cone(self) -> bool:
        return self.criterion.is_smallest_eigenvalue

    @property
    def worst(self) -> bool:
        return self.of_worst

    def edge(self, n: int) -> np.ndarray:
        E = np.zeros((n, n))
        E[self.kept, self.kept] = 1.0
        return E

    def each(self, matrices: np.ndarray) -> np.ndarray:
        if self.is_cone and len(self.kept) == matrices.shape[-1]:
            return np.linalg.eigvalsh(matrices)[:, 0] if np.isfinite(matrices).all() else np.full(len(matrices), -np.inf)
        return np.array([self.criterion.value(shadow(W, self.kept)) for W in matrices])

    def slopes(self, matrices: np.ndarray) -> np.ndarray:
        found = np.empty_like(matrices)
        for i, W in enumerate(matrices):
            L = shadow_lift(W, self.kept)
            found[i] = L @ self.criterion.slope(L.T @ W @ L) @ L.T
        return found

    def curvatures(self, matrices: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        others = np.setdiff1d(np.arange(matrices.shape[-1]), self.kept)
        found = []
        for W, D in zip(matrices, slopes, strict=True):
            L = shadow_lift(W, self.kept)
            V, DL = L.T @ W @ L, D @ L
            bent = self.criterion.curvature(V, L.T @ DL)
            if others.size:
                # d2 shadow = -2 L'D P W_bb^-1 P'D L
                mixed, Z = DL[:, others], self.criterion.slope(V)
                solved = np.linalg.solve(W[np.ix_(others, others)], mixed)
                bent = bent + 2 * np.einsum("iak,kl,jal->ij", mixed, Z, solved)
            found.append(bent)
        return np.array(found)

    def unit(self, matrices: np.ndarray) -> float:
        value = value_of(self, matrices)
        if self.is_cone:
            # 1 where nothing is known at all: a unit next to 0 would make multipliers overflow
            return max(value, _LEAST * float(np.mean(np.trace(matrices, axis1=1, axis2=2))) / matrices.shape[-1]) or 1.0
        return max(abs(value), np.finfo(float).tiny) if np.isfinite(value) and value and self.criterion.resolution == 0 else 1.0


@dataclass(frozen=True, eq=False)
class Linear(AbstractAim):
    """<Z, W> for a given Z (n, n)."""

    Z: np.ndarray

    @property
    def is_cone(self) -> bool:
        return False

    @property
    def worst(self) -> bool:
        return True

    def edge(self, n: int) -> np.ndarray:
        return np.zeros((n, n))

    def each(self, matrices: np.ndarray) -> np.ndarray:
        return np.einsum("ij,bij->b", self.Z, matrices)

    def slopes(self, matrices: np.ndarray) -> np.ndarray:
        return np.broadcast_to(self.Z, matrices.shape)

    def curvatures(self, matrices: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        return np.zeros((len(matrices), slopes.shape[1], slopes.shape[1]))

    def unit(self, matrices: np.ndarray) -> float:
        return float(np.abs(self.each(matrices)).max()) or 1.0


def nothing(n: int) -> Linear:
    """Return the aim that leaves limits alone to be satisfied, and prices to be low."""
    return Linear(np.zeros((n, n)))


def aim_of(problem: DesignProblem) -> Judged:
    """Return what a problem maximises."""
    return Judged(problem.criterion, problem.judged_states, problem.robust is None or problem.robust.worst)
