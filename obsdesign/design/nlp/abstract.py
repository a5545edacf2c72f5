"""What a climb needs to know of a program."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from obsdesign.design.nlp.evaluation import Multipliers, Slopes, Values
from obsdesign.design.problem import DesignProblem


class AbstractProgram(ABC):
    """Matrices to be large and rows to be >= 0, over parameters (q,) in a box; lower, upper (q,): the box."""

    problem: DesignProblem
    lower: np.ndarray
    upper: np.ndarray

    @abstractmethod
    def at(self, p: np.ndarray) -> Values:
        """Return the values at p (q,)."""

    @abstractmethod
    def slopes(self, values: Values) -> Slopes:
        """Return the first derivatives where the values were taken."""

    @abstractmethod
    def curvature(self, values: Values, slopes: Slopes, multipliers: Multipliers) -> np.ndarray:
        """Return the Hessian (q, q) of the Lagrangian: price - sum <Z, matrix> - sum <Z, floor> - z'rows, weighted."""
