"""The extended Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from obsdesign.arguments import validate_arguments
from obsdesign.estimation._linear_update import AbstractLinearisedFilter, linear_update
from obsdesign.estimation._samples import Samples
from obsdesign.estimation.abstract import BeliefGraph


@validate_arguments
@dataclass(frozen=True)
class ExtendedKalmanFilter(AbstractLinearisedFilter):
    """Linearises step and samples at the estimate: m+ = m + K (y - h(m)), P+ = (I - K C) P (I - K C)' + K R K', then f(m), F P F' + Q.

    C = dh/dx and F = df/dx at m; residuals of angles wrap. Sensors whose errors last or hang together have these as states of
    their own, and P is carried as a root then. Source: Bar-Shalom, Li, Kirubarajan (2001), section 10.3; Joseph's form of P+.
    """

    def update(self, samples: Samples, belief: BeliefGraph, is_taken: ca.SX) -> BeliefGraph:
        """Return the belief after the samples that are taken in (q, 1), all linearised at the predicted mean."""
        outputs = samples.linearise(belief.mean)
        return linear_update(belief, outputs, samples.residual(outputs.expected), is_taken)
