"""What a climb needs to know of a program."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from obsdesign.design.nlp.evaluation import Derivatives, Evaluation, Multipliers
from obsdesign.design.problem import DesignProblem


class AbstractProgram(ABC):
    """Matrices to be large and rows to be >= 0, over parameters (q,) in a box; lower, upper (q,): the box."""

    problem: DesignProblem
    lower: np.ndarray
    upper: np.ndarray

    @abstractmethod
    def evaluate(self, p: np.ndarray) -> Evaluation:
        """Return the values at p (q,)."""

    @abstractmethod
    def derivatives(self, evaluation: Evaluation) -> Derivatives:
        """Return the first derivatives where the values were taken."""

    @abstractmethod
    def lagrangian_hessian(self, evaluation: Evaluation, derivatives: Derivatives, multipliers: Multipliers) -> np.ndarray:
        """Return the Hessian (q, q) of the Lagrangian: price - sum <Z, matrix> - sum <Z, floor> - z'rows, weighted."""
