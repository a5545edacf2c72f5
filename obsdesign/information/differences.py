"""Is the perturbation of an empirical Gramian neither so small that rounding shows, nor so large that curvature does?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.information.gramian import empirical_gramian
from obsdesign.model import AbstractSystem
from obsdesign.trajectory import Trajectory

TOLERANCE = 1e-3  # relative error that an empirical Gramian may have and still be called good
_NEAR = 1.001  # between neighbouring perturbations only rounding differs


@dataclass(frozen=True, eq=False)
class Perturbation:
    """What an eps does to an empirical Gramian; all relative to sqrt(W_ii W_jj), the largest over the entries.

    difference: between the Gramians of eps and eps / 2; curvature: estimate of the error that grows as eps^2; rounding:
    estimate of the error that grows as 1/eps; suitable: both are below 1e-3.
    """

    eps: np.ndarray
    difference: float
    curvature: float
    rounding: float

    @property
    def suitable(self) -> bool:
        """Whether the Gramian of this eps can be relied on to three digits."""
        return self.curvature <= TOLERANCE and self.rounding <= TOLERANCE

    @property
    def sentence(self) -> str:
        """Say what was found, and what to do about it."""
        found = f"eps and eps / 2 differ by {self.difference:.1e}: curvature {self.curvature:.1e}, rounding {self.rounding:.1e}"
        if self.suitable:
            return f"{found}; this eps is good to {max(self.curvature, self.rounding):.0e}"
        return f"{found}; take a {'smaller' if self.curvature > self.rounding else 'larger'} eps"


def perturbation(system: AbstractSystem, path: Trajectory, eps: ArrayLike = 1e-4, weighted: bool = True) -> Perturbation:
    """Judge an eps by the empirical Gramians of 2 eps, eps, eps / 2 and of a neighbour of eps.

    The error is c eps^2 + r / eps: W(2 eps) - W(eps) = 3 c eps^2 and W(eps) - W(1.001 eps) = r / eps but for less.
    Raises InputError as empirical_gramian.
    """
    size = np.asarray(eps, dtype=float)
    wide, here, narrow, near = (empirical_gramian(system, path, factor * size, weighted).total for factor in (2.0, 1.0, 0.5, _NEAR))
    rounding = _distance(here, near)
    curvature = _distance(wide, here) / 3
    # the neighbour differs by 0.2 % of the curvature, twice as wide a step by half the rounding
    return Perturbation(
        size,
        _distance(here, narrow),
        max(curvature - rounding, 0.0),
        max(rounding - 2 * (_NEAR - 1) * curvature, 0.0),
    )


def _distance(one: np.ndarray, other: np.ndarray) -> float:
    size = np.sqrt(np.maximum(np.diag(one), np.diag(other)))
    unit = np.outer(size, size)
    return float(np.max(np.abs(one - other) / np.where(unit > 0, unit, 1.0)))
