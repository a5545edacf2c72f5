"""Inputs that change evenly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.paths import _columns
from obsdesign.paths.abstract import AbstractPath, Grid

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np


@dataclass(frozen=True)
class Ramp(AbstractPath):
    """u_k = (1 - s_k) p_first + s_k p_last with s_k from 0 to 1; p (2 m,) in the inputs' units."""

    def box(self, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
        return _columns.repeat_bounds(2, grid)

    def inputs(self, p: ca.SX, grid: Grid) -> ca.SX:
        return _columns.apply_matrix(self._shares(grid), p, grid)

    def fit(self, u: np.ndarray, grid: Grid) -> np.ndarray:
        import numpy as np

        return np.clip(np.linalg.lstsq(self._shares(grid), u)[0].ravel(order="F"), *self.box(grid))

    def coarser(self) -> None:
        return None

    def rates(self, p: ca.SX, grid: Grid) -> ca.SX:
        import numpy as np

        return _columns.apply_matrix(np.array([[-1.0, 1.0]]) / grid.duration, p, grid)

    def _shares(self, grid: Grid) -> np.ndarray:
        import numpy as np

        s = np.linspace(0.0, 1.0, grid.steps)
        return np.column_stack([1 - s, s])
