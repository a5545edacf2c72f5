"""What a path family is: a map from few parameters to an input history."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np


class AbstractPath(ABC):
    """Parameters p (q, m), one column per input, and the inputs u (N, m) they stand for. Leaves are final, one file each."""

    @abstractmethod
    def rows(self, steps: int) -> int:
        """Return q, the number of parameters per input; raise InputError where it does not suit N steps."""

    @abstractmethod
    def inputs(self, p: ca.SX, steps: int) -> ca.SX:
        """Return u (N, m) for parameters p (q, m), symbolic or numerical; u within bounds wherever p is."""

    @abstractmethod
    def fit(self, u: np.ndarray) -> np.ndarray:
        """Return the parameters (q, m) whose inputs are nearest to u (N, m)."""
