"""The extended Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from obsdesign.arguments import validate_arguments
from obsdesign.estimation._linear_update import linear_innovations, linear_move, linear_prediction, linear_update
from obsdesign.estimation._motion import Motion
from obsdesign.estimation._noise import NoiseGraph
from obsdesign.estimation._samples import SampleInnovations, Samples
from obsdesign.estimation._spread import root_graph
from obsdesign.estimation.abstract import AbstractFilter, BeliefGraph, Moved, Prediction


@validate_arguments
@dataclass(frozen=True)
class ExtendedKalmanFilter(AbstractFilter):
    """Linearises step and samples at the estimate: m+ = m + K (y - h(m)), P+ = (I - K C) P (I - K C)' + K R K', then f(m), F P F' + Q.

    C = dh/dx and F = df/dx at m; residuals of angles wrap. Sensors whose errors last or hang together have these as states of
    their own, and P is carried as a root then. Source: Bar-Shalom, Li, Kirubarajan (2001), section 10.3; Joseph's form of P+.
    """

    @property
    def needs_roots(self) -> bool:
        """False."""
        return False

    def innovations(self, samples: Samples, belief: BeliefGraph) -> SampleInnovations:
        """Return y - h(m), and C P C' + R."""
        return linear_innovations(samples, belief)

    def update(self, samples: Samples, belief: BeliefGraph, is_taken: ca.SX) -> BeliefGraph:
        """Return the belief after the samples that are taken in (q, 1), all linearised at the predicted mean."""
        outputs = samples.linearise(belief.mean)
        return linear_update(belief, outputs, samples.residual(outputs.expected), is_taken)

    def predict(self, motion: Motion, belief: BeliefGraph) -> Prediction:
        """Return f(m), and S and F S."""
        return linear_prediction(motion, belief, root_graph(belief.spread))

    def move(self, motion: Motion, belief: BeliefGraph, noise: NoiseGraph) -> Moved:
        """Return f(m) and F P F' + Q."""
        return linear_move(motion, belief, noise)
