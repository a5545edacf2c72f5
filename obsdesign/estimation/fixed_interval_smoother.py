"""The fixed-interval smoother."""

from __future__ import annotations

from dataclasses import dataclass, field

from obsdesign.arguments import validate_arguments
from obsdesign.estimation.abstract import AbstractEstimator, AbstractFilter
from obsdesign.estimation.extended_kalman_filter import ExtendedKalmanFilter


@validate_arguments
@dataclass(frozen=True)
class FixedIntervalSmoother(AbstractEstimator):
    """Goes back through what a filter has estimated, so that each estimate knows the samples after it as well.

    x_k + G (x_k+1 - f(x_k)) and P_k + G (P_k+1 - P_predicted) G', G = P_k F' P_predicted^-1, F of the filter's own step, with roots.
    On a linear system it is the least squares of all samples. Source: Rauch, Tung, Striebel (1965).
    """

    of: AbstractFilter = field(default_factory=ExtendedKalmanFilter)
    """The filter that goes forward; its gate decides what is taken in."""

    @property
    def filter(self) -> AbstractFilter:
        """The one that goes forward."""
        return self.of

    @property
    def is_smoother(self) -> bool:
        """True."""
        return True
