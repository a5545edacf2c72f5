"""What filters share that know a sample by its derivative."""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass

import casadi as ca

from obsdesign.estimation._motion import Motion
from obsdesign.estimation._noise import NoiseGraph
from obsdesign.estimation._samples import Outputs, SampleInnovations, Samples, mask_rows
from obsdesign.estimation._spread import root_graph
from obsdesign.estimation.abstract import AbstractFilter, BeliefGraph, Moved, Prediction


@dataclass(frozen=True)
class AbstractLinearisedFilter(AbstractFilter, ABC):
    """A filter that knows step and samples by their derivatives at the estimate."""

    @property
    def needs_roots(self) -> bool:
        """False."""
        return False

    def innovations(self, samples: Samples, belief: BeliefGraph) -> SampleInnovations:
        """Return y - h(m) and C P C' + R, C the derivative of h at the mean m."""
        return linear_innovations(samples, belief)

    def predict(self, motion: Motion, belief: BeliefGraph) -> Prediction:
        """Return f(m) with columns S before and F S after, F the derivative of the step at the mean m."""
        step, root = motion.linearise(belief.mean), root_graph(belief.spread)
        return Prediction(step.X_next, root, step.F @ root, step.B, step.loop)

    def move(self, motion: Motion, belief: BeliefGraph, noise: NoiseGraph) -> Moved:
        """Return f(m) and F P F' + Q."""
        step = motion.linearise(belief.mean)
        added = noise.at(belief.mean[: motion.model.x.numel(), :], step.B)
        return Moved(BeliefGraph(step.X_next, belief.spread.through(step.F, added)), step.loop)


def linear_innovations(samples: Samples, belief: BeliefGraph) -> SampleInnovations:
    """Return y - h(m) and C P C' + R, C the derivative of h at the mean m."""
    outputs = samples.linearise(belief.mean)
    residual = samples.residual(outputs.expected)
    is_usable = samples.is_usable(outputs.C, residual, outputs.variance)
    C = mask_rows(outputs.C, is_usable)
    variance = ca.if_else(is_usable, outputs.variance, 1)
    covariance = C @ belief.spread.cross_covariance(C) + ca.diag(variance)
    return SampleInnovations(ca.if_else(is_usable, residual, 0), covariance, variance, is_usable)


def linear_update(belief: BeliefGraph, outputs: Outputs, residual: ca.SX, is_taken: ca.SX) -> BeliefGraph:
    """Return the belief after y = C X + noise, residual y - C m, one output after the other: white noise, so that it is all at once."""
    return sequential_update(belief, outputs, residual, is_taken)[0]


def sequential_update(
    belief: BeliefGraph, outputs: Outputs, residual: ca.SX, is_taken: ca.SX
) -> tuple[BeliefGraph, list[ca.SX], list[ca.SX]]:
    """Return the same, and of each output what is new in it after those before it, with the variance that is expected of that."""
    C, correction, spread = mask_rows(outputs.C, is_taken), ca.SX.zeros(belief.mean.numel()), belief.spread
    innovations, variances = [], []
    for i in range(C.shape[0]):
        residual_i = ca.if_else(is_taken[i], residual[i], 0)
        variance = ca.if_else(is_taken[i], outputs.variance[i], 1)
        innovations.append(residual_i - C[i, :] @ correction)
        variances.append(C[i, :] @ spread.cross_covariance(C[i, :]) + variance)
        gain, spread = spread.after_sample(C[i, :], variance)
        correction += gain * innovations[-1]
    return BeliefGraph(belief.mean + correction, spread), innovations, variances
