"""What a filter can know along a path, or after the last samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array
from obsdesign.criteria.abstract import AbstractCriterion, Knowledge, Over
from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.errors import InputError
from obsdesign.noise_density import PerSpeed
from obsdesign.prior import Prior

if TYPE_CHECKING:
    import cvxpy as cp


@validate_arguments
@dataclass(frozen=True)
class Posterior(AbstractCriterion):
    """Another criterion, of what is known of the state on the way or at the end of the path instead of at its start.

    It judges J_k, the posterior information about x(t_k) after its samples, k = 0..N-1, that `posterior_information` returns, in the place
    of W about x(t_0). Not about x(t_N): an unknown input has by then moved the state anywhere. With P_k = S^-1 J_k^-1 S^-1 of the states
    that are judged, in units S, an instant costs

        c_k = tr P_k (`TraceInverse`),  lambda_max(P_k) (`MinEigenvalue`)  or  log det P_k (`LogDet`)

    and the path C = c_N-1 (over "end"), the mean of all c_k ("mean"), the largest ("worst") or sum_k w_k c_k (weights w). The value, larger
    is better, is -C, or 1 / C of `MinEigenvalue`: what criterion(S J S) would be if it were the same all the way at this cost. So the
    mean of a smallest eigenvalue is the harmonic one: the variance of the direction known least is averaged, not the information,
    and the best path is that of the least C, whichever criterion. (Any other criterion: the same of its numbers.)

    "worst" is often the first instant, before there was time to learn: no path changes that one; weights leave it out. The cost is
    infinite where nothing is known of some direction: with unknown inputs, at instants without samples that show them.
    Not additive over sensors and steps: `select_sensors` does not know of it. Source of J: Tichavsky, Muravchik, Nehorai (1998).
    """

    prior: Prior
    """What is known of x(t_0) before the first sample."""
    disturbance_psd: tuple[float, ...] | tuple[tuple[float, ...], ...] | PerSpeed | None = None
    """Power spectral density (n,) or (n, n) of the process noise [unit^2/s], or a PerSpeed of it; None = none."""
    unknown_inputs: tuple[str, ...] = ()
    """Names of the inputs of which nothing is known."""
    criterion: AbstractCriterion = field(default_factory=MinEigenvalue)
    """What is asked of J (n, n), scaled as W is."""
    over: Over = "end"
    """Of which instants: the last, the mean of all costs, the largest, or their sum with weights (N,) >= 0, one for each step."""
    input_psd: Mapping[str, float | PerSpeed] | tuple[tuple[str, float | PerSpeed], ...] = ()
    """Known input -> power spectral density of its white noise [unit^2 s], or a PerSpeed of it; pairs of the two afterwards."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "input_psd", tuple(dict(self.input_psd).items()))
        if self.disturbance_psd is not None and not isinstance(self.disturbance_psd, PerSpeed):
            psd = as_array("posterior: disturbance_psd", self.disturbance_psd).tolist()
            object.__setattr__(self, "disturbance_psd", tuple(tuple(row) if isinstance(row, list) else row for row in psd))
        object.__setattr__(self, "unknown_inputs", tuple(self.unknown_inputs))
        if not isinstance(self.over, str):
            object.__setattr__(self, "over", _as_weights(self.over))

    @property
    def label(self) -> str:
        """posterior, after which of the instants it is of where that is not the last: mean, worst, weighted."""
        if self.over == "end":
            return "posterior"
        return f"{self.over if isinstance(self.over, str) else 'weighted'} posterior"

    @property
    def symbol(self) -> str:
        """The label."""
        return self.label

    @property
    def knowledge(self) -> Knowledge:
        """What makes J of the samples: the prior, the process noise, the unknown inputs; and when J is judged."""
        return Knowledge(self.prior, self.disturbance_psd, self.unknown_inputs, tuple(dict(self.input_psd).items()), self.over)

    def value(self, W: np.ndarray) -> float:
        """Return criterion(J)."""
        return self.criterion.value(W)

    def value_from_root(self, R: np.ndarray) -> np.ndarray:
        """Return criterion of J = (R'R)^-1."""
        return self.criterion.value_from_root(R)

    def covariance_cost(self, P: np.ndarray) -> np.ndarray:
        """Return the criterion's cost."""
        return self.criterion.covariance_cost(P)

    def covariance_cost_of_root(self, B: np.ndarray) -> np.ndarray:
        """Return the criterion's cost."""
        return self.criterion.covariance_cost_of_root(B)

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


def _as_weights(over: ArrayLike) -> tuple[float, ...]:
    """Weights of instants as a tuple; raise InputError unless finite, >= 0 and not all 0."""
    weights = as_array("posterior: over", over)
    if weights.ndim != 1 or not weights.size:
        raise InputError(f"posterior: over has shape {weights.shape}: must be end, mean, worst or weights (N,), one for each step")
    wrong = np.flatnonzero(~(np.isfinite(weights) & (weights >= 0)))
    if wrong.size:
        raise InputError(f"posterior: over[{wrong[0]}] is {weights[wrong[0]]:g}: must be finite and at least 0")
    if not weights.any():
        raise InputError(f"posterior: over has {weights.size} weights, all 0: one at least must be above 0")
    return tuple(weights.tolist())
