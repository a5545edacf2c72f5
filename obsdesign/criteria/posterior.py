"""What a filter can know after the last samples."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array
from obsdesign.criteria.abstract import AbstractCriterion, Knowledge
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.prior import Prior

if TYPE_CHECKING:
    import cvxpy as cp


@validate_arguments
@dataclass(frozen=True)
class Posterior(AbstractCriterion):
    """Another criterion, of what is known at the end of the path instead of at its start.

    It judges J, the posterior information about x(t_N-1) after its samples, that `posterior_information` returns, in the place of W about
    x(t_0). Not about x(t_N): an unknown input has by then moved the state anywhere. It is not additive over sensors and steps: no
    schedule is optimal for it. With unknown inputs, sensors should have samples at t_N-1: along what only earlier samples show, nothing
    is known any more. Source of J: Tichavsky, Muravchik, Nehorai (1998).
    """

    prior: Prior
    """What is known of x(t_0) before the first sample."""
    disturbance_psd: tuple[float, ...] | tuple[tuple[float, ...], ...] | None = None
    """Power spectral density (n,) or (n, n) of the process noise [unit^2/s]; None = none."""
    unknown_inputs: tuple[str, ...] = ()
    """Names of the inputs of which nothing is known."""
    criterion: AbstractCriterion = field(default_factory=MinEigenvalue)
    """What is asked of J (n, n), scaled as W is."""

    def __post_init__(self) -> None:
        if self.disturbance_psd is not None:
            psd = as_array("posterior: disturbance_psd", self.disturbance_psd).tolist()
            object.__setattr__(self, "disturbance_psd", tuple(tuple(row) if isinstance(row, list) else row for row in psd))
        object.__setattr__(self, "unknown_inputs", tuple(self.unknown_inputs))

    @property
    def label(self) -> str:
        """posterior."""
        return "posterior"

    @property
    def symbol(self) -> str:
        """The label."""
        return self.label

    @property
    def knowledge(self) -> Knowledge:
        """What makes J of the samples: the prior, the process noise, the unknown inputs."""
        return Knowledge(self.prior, self.disturbance_psd, self.unknown_inputs)

    def value(self, W: np.ndarray) -> float:
        """Return criterion(J)."""
        return self.criterion.value(W)

    def value_from_root(self, R: np.ndarray) -> np.ndarray:
        """Return criterion of J = (R'R)^-1."""
        return self.criterion.value_from_root(R)

    def covariance_cost(self, P: np.ndarray) -> np.ndarray:
        """Return the criterion's cost."""
        return self.criterion.covariance_cost(P)

    @property
    def is_trace_of_covariance(self) -> bool:
        """Whether the criterion's cost is tr P."""
        return self.criterion.is_trace_of_covariance

    def slope(self, W: np.ndarray) -> np.ndarray:
        """Return the slope of the criterion at J."""
        return self.criterion.slope(W)

    @property
    def resolution(self) -> float:
        """That of the criterion."""
        return self.criterion.resolution

    @property
    def scales_with_information(self) -> bool:
        """False: what is known beforehand does not grow with the samples."""
        return False  # what is known beforehand does not grow with the samples

    @property
    def is_smallest_eigenvalue(self) -> bool:
        """Whether the criterion is the smallest eigenvalue."""
        return self.criterion.is_smallest_eigenvalue

    def curvature(self, W: np.ndarray, D: np.ndarray) -> np.ndarray:
        """Return the curvature of the criterion at J."""
        return self.criterion.curvature(W, D)

    def atom(self, W: cp.Expression) -> cp.Expression:
        """Return the criterion's expression of J."""
        return self.criterion.atom(W)
