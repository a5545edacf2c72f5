"""Inputs that follow splines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from obsdesign.checks import require_count
from obsdesign.errors import InputError
from obsdesign.paths import _columns
from obsdesign.paths.abstract import AbstractCheckablePath, Grid

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np

_COARSE = 12  # points that are few


@dataclass(frozen=True)
class BSpline(AbstractCheckablePath):
    """Inputs that are smooth curves: of each input the clamped B-spline over uniform knots, u = M p.

    u_k = mean over step k of sum_j p_j B_j(t). B_j >= 0 and sum_j B_j = 1, so u stays between the smallest and the largest control
    point. The mean, not the value in the middle: integrals of the inputs, such as the heading, are those of the splines at every node.
    Parameters p (points m,), in the inputs' units: the control points of the first input, then those of the second, ...
    Raises InputError unless degree >= 1 and degree < points <= N. Source: de Boor (1978).
    """

    points: int
    """Number of control points of each input; more of them allow sharper changes."""
    degree: int = 3
    """Degree of the polynomials between two knots: 1 = straight pieces, 3 = cubic ones."""

    def __post_init__(self) -> None:
        require_count("degree", self.degree)
        require_count("points", self.points)
        if self.points <= self.degree:
            raise InputError(f"points is {self.points}: must be more than the degree, {self.degree}")

    def box(self, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
        """Return the inputs' bounds, for every control point."""
        self.require_suits(grid)
        return _columns.repeat_bounds(self.points, grid)

    def require_suits(self, grid: Grid) -> None:
        """Raise InputError for more control points than steps."""
        _columns.require_at_most_steps("points", self.points, grid)

    def inputs(self, p: ca.SX, grid: Grid) -> ca.SX:
        """Return u = M p, the mean of each spline over every step."""
        return _columns.apply_matrix(self._means(grid), p, grid)

    def fit(self, u: np.ndarray, grid: Grid) -> np.ndarray:
        """The bounded least squares: min |M p - u|^2 with p in its box."""
        import numpy as np
        from scipy.optimize import lsq_linear

        M = self._means(grid)
        is_fixed = [lower >= upper for lower, upper in zip(grid.lower, grid.upper, strict=True)]
        control_points = [
            np.full(self.points, lower) if fixed else lsq_linear(M, column, (lower, upper), method="bvls").x
            for column, lower, upper, fixed in zip(u.T, grid.lower, grid.upper, is_fixed, strict=True)
        ]
        return np.clip(np.concatenate(control_points), *self.box(grid))

    def coarser(self) -> BSpline | None:
        """Return the splines of half as many control points, None for 12 or fewer."""
        fewer = max((self.points + 1) // 2, self.degree + 1)
        return BSpline(fewer, self.degree) if self.points > _COARSE and fewer < self.points else None

    def rates(self, p: ca.SX, grid: Grid) -> ca.SX:
        """Control points of the derivative, between the least and greatest of which it lies."""
        import numpy as np

        knots = _knots(self.points, self.degree) * grid.duration
        spans = (knots[self.degree + 1 : -1] - knots[1 : -self.degree - 1]) / self.degree
        return _columns.apply_matrix(np.diff(np.eye(self.points), axis=0) / spans[:, None], p, grid)

    def _means(self, grid: Grid) -> np.ndarray:
        _columns.require_at_most_steps("points", self.points, grid)
        return _means(self.points, self.degree, grid.steps)


def _knots(points: int, degree: int) -> np.ndarray:
    """Knots (points + degree + 1,) from 0 to 1, each end repeated."""
    import numpy as np

    return np.concatenate([np.zeros(degree), np.linspace(0, 1, points - degree + 1), np.ones(degree)])


@lru_cache(32)
def _means(points: int, degree: int, steps: int) -> np.ndarray:
    """M (N, points): means of the basis functions over N equal steps."""
    import numpy as np
    from scipy.interpolate import BSpline as Spline

    integrals = Spline(_knots(points, degree), np.eye(points), degree).antiderivative()(np.linspace(0, 1, steps + 1))
    M = np.maximum(np.diff(integrals, axis=0), 0)
    M /= M.sum(axis=1, keepdims=True)  # what rounding took
    M.flags.writeable = False
    return M
