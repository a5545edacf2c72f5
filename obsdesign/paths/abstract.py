"""What a path family is: a map from few parameters to an input history."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np


@dataclass(frozen=True)
class Grid:
    """What a family fills with inputs: N = `steps` steps of `step` seconds, and the m inputs by name with their bounds (m,)."""

    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    steps: int
    step: float

    @property
    def duration(self) -> float:
        """N * step [s]."""
        return self.steps * self.step

    @property
    def centre(self) -> np.ndarray:
        """Middle (m,) of each input's range."""
        import numpy as np

        return (np.array(self.lower) + np.array(self.upper)) / 2


class AbstractPath(ABC):
    """Parameters p (q,) and the inputs u (N, m) they stand for, smooth in p. Leaves are final, one file each."""

    @abstractmethod
    def box(self, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
        """Return lower and upper bounds (q,) of the parameters; raise InputError where the family does not suit the grid."""

    @abstractmethod
    def inputs(self, p: ca.SX, grid: Grid) -> ca.SX:
        """Return u (N, m) for parameters p (q,), symbolic or numerical; u within bounds wherever p is in its box."""

    @abstractmethod
    def fit(self, u: np.ndarray, grid: Grid) -> np.ndarray:
        """Return parameters (q,) in the box whose inputs are near u (N, m); those of u itself where u is of this family."""

    @abstractmethod
    def coarser(self) -> AbstractPath | None:
        """Return a family of about half as many parameters whose local optima are easier to find, or None where this is coarse."""

    @abstractmethod
    def rates(self, p: ca.SX, grid: Grid) -> ca.SX:
        """Return rates of change (r, m) [unit/s], the largest of which no du/dt of this path exceeds, for a bound on rates."""


class AbstractCheckablePath(AbstractPath):
    """A family that says whether it suits a grid without its box, so that a scenario is checked without NumPy."""

    @abstractmethod
    def require_suits(self, grid: Grid) -> None:
        """Raise InputError where the family does not suit the grid."""
