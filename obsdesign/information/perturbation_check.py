"""Is the perturbation of an empirical Gramian neither so small that rounding shows, nor so large that curvature does?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.display import AbstractDisplay, Summary
from obsdesign.dynamics.model import AbstractSystem
from obsdesign.information.gramian import variational_gramian
from obsdesign.information.output_differences import as_perturbation, empirical_gramian
from obsdesign.trajectory import Trajectory

TOLERANCE = 1e-3  # relative error that an empirical Gramian may have and still be called good


@dataclass(frozen=True, eq=False)
class Perturbation(AbstractDisplay):
    """What an eps does to an empirical Gramian; all errors are relative to sqrt(W_ii W_jj), the largest over the entries."""

    eps: np.ndarray
    """The perturbation (n,), in the unit of each state."""
    difference: float
    """Between the Gramians of eps and eps / 2."""
    curvature: float
    """The part of the error that grows as eps^2."""
    rounding: float
    """The rest of the error, which grows as 1/eps; `suitable` says that both together are below 1e-3."""

    def _summary(self) -> Summary:
        return Summary("perturbation of an empirical Gramian", (("result", self.sentence),))

    @property
    def suitable(self) -> bool:
        """Whether the Gramian of this eps can be relied on to three digits."""
        return self.curvature + self.rounding <= TOLERANCE

    @property
    def sentence(self) -> str:
        """Say what was found, and what to do about it."""
        text = f"eps and eps / 2 differ by {self.difference:.1e}: curvature {self.curvature:.1e}, rounding {self.rounding:.1e}"
        if self.suitable:
            return f"{text}; this eps is good to {self.curvature + self.rounding:.0e}"
        return f"{text}; take a {'smaller' if self.curvature > self.rounding else 'larger'} eps"


@validate_arguments
def perturbation(system: AbstractSystem, path: Trajectory, eps: ArrayLike = 1e-4, weighted: bool = True) -> Perturbation:
    """Judge an eps by the empirical Gramians of eps and eps / 2, and by the variational one, which has no eps.

    Curvature falls to a quarter from eps to eps / 2; what does not fall is rounding, and so is its share of what falls less.

    Arguments:
        system: vehicle and sensors.
        path: the path about whose start the Gramians are.
        eps: perturbation in the unit of each state, > 0, one number or (n,).
        weighted: False = without R, as in empirical_gramian.
    Raises InputError as empirical_gramian.
    """
    size = as_perturbation(system, eps)
    exact = variational_gramian(system, path, weighted).total
    full, half = (empirical_gramian(system, path, factor * size, weighted).total for factor in (1.0, 0.5))
    error = _distance(full, exact)
    rounding = error and error * float(np.clip((_distance(half, exact) / error - 0.25) / 0.75, 0.0, 1.0))
    return Perturbation(size, _distance(full, half), error - rounding, rounding)


def _distance(first: np.ndarray, second: np.ndarray) -> float:
    size = np.sqrt(np.maximum(np.diag(first), np.diag(second)))
    unit = np.outer(size, size)
    return float(np.max(np.abs(first - second) / np.where(unit > 0, unit, 1.0)))
