"""The nonlinear program as the solver sees it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np

from obsdesign.design.sqp.evaluation import AbstractDerivatives, AbstractEvaluation, Multipliers

Values = TypeVar("Values", bound=AbstractEvaluation)
Slopes = TypeVar("Slopes", bound=AbstractDerivatives)


class AbstractProgram(ABC, Generic[Values, Slopes]):
    """maximise f(matrices(p)) - price(p) subject to rows(p) >= 0, floors(p) >= floor_level I, lower <= p <= upper.

    lower, upper (q,): the box; floor_level > 0: what the smallest eigenvalue of every floor must be at least. f: an
    `AbstractMatrixObjective`.
    """

    lower: np.ndarray
    upper: np.ndarray

    @property
    @abstractmethod
    def floor_level(self) -> float:
        """What the smallest eigenvalue of every floor must be at least, > 0; 1 without floors."""

    @abstractmethod
    def evaluate(self, p: np.ndarray) -> Values:
        """Return the values at p (q,)."""

    @abstractmethod
    def derivatives(self, evaluation: Values) -> Slopes:
        """Return the first derivatives where the values were taken."""

    @abstractmethod
    def lagrangian_hessian(self, evaluation: Values, derivatives: Slopes, multipliers: Multipliers) -> np.ndarray:
        """Return the Hessian (q, q) of the Lagrangian: price - sum <Z, matrix> - sum <Z, floor> - z'rows, weighted."""


AnyProgram: TypeAlias = AbstractProgram[Any, Any]
