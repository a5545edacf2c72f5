"""What a nonlinear program is at a point: values, first derivatives, and the multipliers of its Lagrangian."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class AbstractEvaluation(ABC):
    """At parameters p (q,): matrices (b, n, n) to be judged, floors (f, n, n) to be kept, rows (r,) >= 0, price.

    A program adds what it needs for its derivatives.
    """

    p: np.ndarray
    matrices: np.ndarray
    floors: np.ndarray
    rows: np.ndarray
    price: float


@dataclass(frozen=True, eq=False)
class AbstractDerivatives(ABC):
    """First derivatives: matrices (b, q, n, n), floors (f, q, n, n), rows (r, q), price (q,).

    A program adds what it needs for its second derivatives.
    """

    matrices: np.ndarray
    floors: np.ndarray
    rows: np.ndarray
    price: np.ndarray


@dataclass(frozen=True, eq=False)
class Multipliers:
    """What the Lagrangian counts the matrices (b, n, n), the floors (f, n, n), the rows (r,) and the price for, all >= 0."""

    matrices: np.ndarray
    floors: np.ndarray
    rows: np.ndarray
    price: float

    def scale(self, factor: float) -> Multipliers:
        """Return all of them multiplied."""
        return Multipliers(self.matrices * factor, self.floors * factor, self.rows * factor, self.price * factor)

    def with_rows(self, old_count: int, new_count: int) -> Multipliers:
        """Return multipliers for more rows of constraints than before: nothing for those that are new."""
        extended = np.concatenate([self.rows[:old_count], np.zeros(new_count - old_count), self.rows[old_count:]])
        return Multipliers(self.matrices, self.floors, extended, self.price)
