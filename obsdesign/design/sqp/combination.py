"""How the numbers of several matrices make the one that is maximised."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

_NOTHING = 1e-12  # share of the largest number below which one counts as so much: 1 / 0 has no slope


class AbstractCombination(ABC):
    """A concave function of the numbers v (b,) of several matrices, growing with each of them."""

    @property
    @abstractmethod
    def is_smallest(self) -> bool:
        """Whether it is the smallest of the numbers, which has no slope where two are equal."""

    @abstractmethod
    def total(self, v: np.ndarray) -> float:
        """Return the one number of v (b,)."""

    @abstractmethod
    def slope(self, v: np.ndarray) -> np.ndarray:
        """Return a (b,) with total(v + dv) <= total(v) + a'dv: the gradient where there is one."""

    @abstractmethod
    def curvature(self, v: np.ndarray) -> np.ndarray | None:
        """Return minus the Hessian (b, b) >= 0 of the total at v; None: it does not bend."""

    @abstractmethod
    def model_total(self, v: np.ndarray, moved: np.ndarray) -> float:
        """Return what a model about v, without its curvature, says that the total of moved numbers (b,) is."""


@dataclass(frozen=True)
class Smallest(AbstractCombination):
    """min_k v_k."""

    @property
    def is_smallest(self) -> bool:
        """True."""
        return True

    def total(self, v: np.ndarray) -> float:
        """Return the smallest."""
        return float(v.min())

    def slope(self, v: np.ndarray) -> np.ndarray:
        """Return 1 at the first of the smallest, 0 elsewhere."""
        return (np.arange(len(v)) == int(v.argmin())).astype(float)

    def curvature(self, v: np.ndarray) -> None:
        """None: it is linear but for its edges, which a model has as they are."""
        return

    def model_total(self, v: np.ndarray, moved: np.ndarray) -> float:
        """Return the smallest of the moved numbers."""
        return float(moved.min())


@dataclass(frozen=True)
class Mean(AbstractCombination):
    """sum_k v_k / b."""

    @property
    def is_smallest(self) -> bool:
        """False."""
        return False

    def total(self, v: np.ndarray) -> float:
        """Return the mean."""
        return float(v.mean())

    def slope(self, v: np.ndarray) -> np.ndarray:
        """Return 1 / b for each."""
        return np.full(len(v), 1 / len(v))

    def curvature(self, v: np.ndarray) -> None:
        """None: it is linear."""
        return

    def model_total(self, v: np.ndarray, moved: np.ndarray) -> float:
        """Return the mean of the moved numbers."""
        return float(moved.mean())


@dataclass(frozen=True, eq=False)
class WeightedSum(AbstractCombination):
    """sum_k w_k v_k, weights w (b,) > 0."""

    weights: np.ndarray

    @property
    def is_smallest(self) -> bool:
        """False."""
        return False

    def total(self, v: np.ndarray) -> float:
        """Return w'v."""
        return float(self.weights @ v)

    def slope(self, v: np.ndarray) -> np.ndarray:
        """Return w."""
        return self.weights

    def curvature(self, v: np.ndarray) -> None:
        """None: it is linear."""
        return

    def model_total(self, v: np.ndarray, moved: np.ndarray) -> float:
        """Return w'moved."""
        return float(self.weights @ moved)


@dataclass(frozen=True, eq=False)
class ReciprocalSum(AbstractCombination):
    """f = 1 / sum_k w_k / v_k, weights w (b,) > 0: the number of which the reciprocal is the weighted sum of the reciprocals.

    0 where a number is 0, and the smallest where one is negative. With a_k = f^2 w_k / v_k^2 its slope, -d2f = 2 (diag(a / v) - a a' / f),
    which is >= 0 by Cauchy and Schwarz: f is concave in v > 0.
    """

    weights: np.ndarray

    @property
    def is_smallest(self) -> bool:
        """False."""
        return False

    def total(self, v: np.ndarray) -> float:
        """Return f, min(v) where that is 0 or less."""
        return self._total(v) if v.min() > 0 else float(v.min())

    def slope(self, v: np.ndarray) -> np.ndarray:
        """Return a, at numbers that are held above 0."""
        u = _positive(v)
        return self._total(u) ** 2 * self.weights / u**2

    def curvature(self, v: np.ndarray) -> np.ndarray:
        """Return 2 (diag(a / v) - a a' / f), at numbers that are held above 0."""
        u, a = _positive(v), self.slope(v)
        return 2 * (np.diag(a / u) - np.outer(a, a) / self._total(u))

    def model_total(self, v: np.ndarray, moved: np.ndarray) -> float:
        """Return f + a'(moved - v)."""
        return self.total(v) + float(self.slope(v) @ (moved - v))

    def _total(self, v: np.ndarray) -> float:
        return 1 / float(np.sum(self.weights / v))


def _positive(v: np.ndarray) -> np.ndarray:
    """Numbers v (b,), those that are next to nothing replaced by so little; 1 where all are."""
    largest = float(v.max())
    return np.maximum(v, _NOTHING * largest) if np.isfinite(largest) and largest > 0 else np.ones(len(v))
