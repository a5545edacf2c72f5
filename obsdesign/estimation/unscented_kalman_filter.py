"""The unscented Kalman filter, with roots of covariances."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import casadi as ca

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_within
from obsdesign.estimation._motion import Motion
from obsdesign.estimation._noise import NoiseGraph
from obsdesign.estimation._samples import SampleInnovations, Samples, wrap_if_angle
from obsdesign.estimation._spread import RootSpread, root_graph
from obsdesign.estimation.abstract import AbstractFilter, BeliefGraph, Moved, Prediction
from obsdesign.information.householder import triangular_factor


@validate_arguments
@dataclass(frozen=True)
class UnscentedKalmanFilter(AbstractFilter):
    """Moves points about the mean through step and samples instead of derivatives, and carries S, S S' = P.

    Points m and m +- (n + kappa)^1/2 S_j, weights kappa / (n + kappa) and 1 / (2 (n + kappa)): means of quadratic functions are exact,
    and none of the weights is negative, so that S is a triangular factor of columns. n counts the errors of samples that last as well.
    Raises InputError for kappa < 0. Source: Julier and Uhlmann (1997); roots as in van der Merwe and Wan (2001).
    """

    kappa: float | None = None
    """How far out the points are, >= 0; None = 3 - n, which gets fourth moments along the axes right too, but not below 0."""

    def __post_init__(self) -> None:
        if self.kappa is not None:
            require_within("kappa", self.kappa)

    @property
    def needs_roots(self) -> bool:
        """True."""
        return True

    def innovations(self, samples: Samples, belief: BeliefGraph) -> SampleInnovations:
        """Return y - E h(X), and the covariance of h(X) + noise."""
        moments = self._moments(samples, belief)
        covariance = moments.columns @ moments.columns.T + ca.diag(moments.variance)
        return SampleInnovations(moments.residual, covariance, moments.variance, moments.is_usable)

    def update(self, samples: Samples, belief: BeliefGraph, is_taken: ca.SX) -> BeliefGraph:
        """Return the belief after the samples that are taken in (q, 1).

        The lower triangular root of [Y R^1/2; X 0], Y and X the columns of outputs and states, is [A 0; K A S+]: K is the gain.
        """
        moments, q, n = self._moments(samples, belief), is_taken.numel(), belief.mean.numel()
        if not q:
            return belief
        Y = ca.vertcat(*[ca.if_else(is_taken[i], moments.columns[i, :], 0) for i in range(q)])
        noise = ca.diag(ca.sqrt(ca.if_else(is_taken, moments.variance, 1)))
        X = self._columns([column - belief.mean for column in self._points(belief)], ca.SX.zeros(n))
        joint = ca.vertcat(ca.horzcat(Y, noise), ca.horzcat(X, ca.SX(n, q)))
        root = triangular_factor(joint.T).T
        scaled = _forward_substitution(root[:q, :q], ca.if_else(is_taken, moments.residual, 0))
        return BeliefGraph(belief.mean + root[q:, :q] @ scaled, RootSpread(root[q:, q:]))

    def predict(self, motion: Motion, belief: BeliefGraph) -> Prediction:
        """Return the mean of the points one step later, and the columns of their differences from the mean, before and after."""
        points = self._points(belief)
        moved = motion.move(points)
        differences = [point - moved.points[0] for point in moved.points]
        shift = self._mean(differences)
        before = self._columns([point - belief.mean for point in points], ca.SX.zeros(belief.mean.numel()))
        B = motion.input_columns(belief.mean)
        return Prediction(moved.points[0] + shift, before, self._columns(differences, shift), B, moved.loop)

    def move(self, motion: Motion, belief: BeliefGraph, noise: NoiseGraph) -> Moved:
        """Return the belief one step later."""
        prediction = self.predict(motion, belief)
        return prediction.with_noise(noise.at(belief.mean[: motion.model.x.numel(), :], prediction.B))

    def _kappa(self, n: int) -> float:
        return max(3.0 - n, 0.0) if self.kappa is None else self.kappa

    def _points(self, belief: BeliefGraph) -> list[ca.SX]:
        """The mean, and the points on both sides of it."""
        m, S, n = belief.mean, root_graph(belief.spread), belief.mean.numel()
        offsets = ca.horzsplit(ca.densify(sqrt(n + self._kappa(n)) * S))
        return [m, *(m + offset for offset in offsets), *(m - offset for offset in offsets)]

    def _mean(self, differences: list[ca.SX]) -> ca.SX:
        """Return the weighted mean of differences from the first point."""
        n = len(differences) // 2
        return sum(differences[1:], ca.SX(0)) / (2 * (n + self._kappa(n)))

    def _columns(self, differences: list[ca.SX], mean: ca.SX) -> ca.SX:
        """Return the differences about their mean as columns of which the covariance is the sum of squares."""
        n = len(differences) // 2
        kappa = self._kappa(n)
        weights = [sqrt(kappa / (n + kappa))] * (kappa > 0) + [sqrt(1 / (2 * (n + kappa)))] * (2 * n)
        return ca.horzcat(*[weight * (difference - mean) for weight, difference in zip(weights, differences[-len(weights) :], strict=True)])

    def _moments(self, samples: Samples, belief: BeliefGraph) -> _Moments:
        """Return what the points say of the samples."""
        values = [samples.expect(point) for point in self._points(belief)]
        centre, signals = values[0].expected, samples.model.outputs
        differences = [
            ca.vertcat(*[wrap_if_angle(signal.is_angle, value.expected[i] - centre[i]) for i, signal in enumerate(signals)])
            for value in values
        ]
        shift = self._mean(differences)
        columns, residual = self._columns(differences, shift), samples.residual(centre + shift)
        is_usable = samples.is_usable(columns, residual, values[0].variance)
        columns = ca.vertcat(*[ca.if_else(is_usable[i], columns[i, :], 0) for i in range(len(signals))])
        return _Moments(ca.if_else(is_usable, residual, 0), columns, ca.if_else(is_usable, values[0].variance, 1), is_usable)


@dataclass(frozen=True, eq=False)
class _Moments:
    """Residual (q, 1), columns (q, r) of the noise-free outputs, variance (q, 1) of what is white, and which outputs are usable."""

    residual: ca.SX
    columns: ca.SX
    variance: ca.SX
    is_usable: ca.SX


def _forward_substitution(L: ca.SX, e: ca.SX) -> ca.SX:
    """Return L^-1 e for a lower triangular L."""
    solution: list[ca.SX] = []
    for i in range(e.numel()):
        solution.append((e[i] - sum((L[i, j] * solution[j] for j in range(i)), ca.SX(0))) / L[i, i])
    return ca.vertcat(*solution)
