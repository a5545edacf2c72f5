"""The iterated extended Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count
from obsdesign.estimation._linear_update import AbstractLinearisedFilter, linear_update
from obsdesign.estimation._samples import Samples
from obsdesign.estimation.abstract import BeliefGraph


@validate_arguments
@dataclass(frozen=True)
class IteratedExtendedKalmanFilter(AbstractLinearisedFilter):
    """Linearises the samples again where they have moved the estimate: m_j+1 = m + K_j (y - h(m_j) - C_j (m - m_j)), m_0 = m.

    Gauss-Newton for the most likely state, the least (x - m)' P^-1 (x - m) + (y - h(x))' R^-1 (y - h(x)): of use where a sample says
    much that is far from linear, as the first range does. P+ and R are those of the last m_j. Predicts as the extended Kalman
    filter. Raises InputError for iterations below 1. Source: Bell and Cathey (1993), IEEE Trans. Automat. Control 38, 294-297.
    """

    iterations: int = 3
    """How often the samples of an instant are linearised; 1 is the extended Kalman filter."""

    def __post_init__(self) -> None:
        require_count("iterations", self.iterations)

    def update(self, samples: Samples, belief: BeliefGraph, is_taken: ca.SX) -> BeliefGraph:
        """Return the belief after the samples that are taken in (q, 1)."""
        updated = belief
        for _ in range(self.iterations):
            outputs = samples.linearise(updated.mean)
            way_back = outputs.C @ (belief.mean - updated.mean)
            updated = linear_update(belief, outputs, samples.residual(outputs.expected) - way_back, is_taken)
        return updated
