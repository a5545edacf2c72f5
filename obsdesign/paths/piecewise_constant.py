"""Inputs held over pieces of nearly equal length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.checks import require_count
from obsdesign.paths import _columns
from obsdesign.paths.abstract import AbstractCheckablePath, Grid

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np

_COARSE = 12  # pieces that are few


@dataclass(frozen=True)
class PiecewiseConstant(AbstractCheckablePath):
    """Inputs that are held over pieces of equal length: u_k = p_j for every step k of piece j.

    Piece j lasts from round(j N / pieces) on, so that lengths differ by one step at most.
    Parameters p (pieces m,), in the inputs' units: the pieces of the first input, then those of the second, ...
    Rates are the slopes between the middles of neighbouring pieces: the inputs themselves jump.
    Raises InputError for pieces that are no count, and for more pieces than steps.
    """

    pieces: int
    """Number of pieces of each input."""

    def __post_init__(self) -> None:
        require_count("pieces", self.pieces)

    def box(self, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
        """Return the inputs' bounds, for every piece."""
        self.require_suits(grid)
        return _columns.repeat_bounds(self.pieces, grid)

    def require_suits(self, grid: Grid) -> None:
        """Raise InputError for more pieces than steps."""
        _columns.require_at_most_steps("pieces", self.pieces, grid)

    def inputs(self, p: ca.SX, grid: Grid) -> ca.SX:
        """Return u_k = p_j for every step k of piece j."""
        import numpy as np

        return _columns.columns(p, grid)[np.repeat(np.arange(self.pieces), self._lengths(grid)).tolist(), :]

    def fit(self, u: np.ndarray, grid: Grid) -> np.ndarray:
        """Return the means of u over the pieces: the least squares."""
        import numpy as np

        lengths = self._lengths(grid)
        means = np.add.reduceat(u, np.cumsum(lengths) - lengths) / lengths[:, None]
        return np.clip(means.ravel(order="F"), *self.box(grid))

    def coarser(self) -> PiecewiseConstant | None:
        """Return half as many pieces, None for 12 or fewer."""
        return PiecewiseConstant((self.pieces + 1) // 2) if self.pieces > _COARSE else None

    def rates(self, p: ca.SX, grid: Grid) -> ca.SX:
        """Return (p_j+1 - p_j) / the time between the middles of the two pieces [unit/s]."""
        import numpy as np

        lengths = self._lengths(grid) * grid.step
        return _columns.apply_matrix(np.diff(np.eye(self.pieces), axis=0) * (2 / (lengths[1:] + lengths[:-1]))[:, None], p, grid)

    def _lengths(self, grid: Grid) -> np.ndarray:
        """Steps in each piece (pieces,)."""
        _columns.require_at_most_steps("pieces", self.pieces, grid)
        return piece_lengths(self.pieces, grid.steps)


def piece_lengths(pieces: int, steps: int) -> np.ndarray:
    """Return how many of so many steps are in each piece (pieces,): piece j begins at round(j steps / pieces)."""
    import numpy as np

    return np.diff((2 * np.arange(pieces + 1) * steps + pieces) // (2 * pieces))
