"""The samples of one instant as a graph: what is expected of them at a state, and what of them is noise."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.nuisance_states import NuisanceStates

_LARGEST = 1e300  # beyond it, and where it is nan, a number is of no use


@dataclass(frozen=True, eq=False)
class Outputs:
    """y = expected + C (X - X_0) + white noise: C (q, n), expected (q, 1), and the variances (q, 1) of what is white in a sample."""

    C: ca.SX
    expected: ca.SX
    variance: ca.SX


@dataclass(frozen=True, eq=False)
class ExpectedOutputs:
    """What the outputs are without white noise (q, 1), and the variances (q, 1) of that."""

    expected: ca.SX
    variance: ca.SX


@dataclass(frozen=True, eq=False)
class Samples:
    """The outputs y (q, 1) of an instant, and how often each counts, active (q, 1), 0 where it is not there.

    X = (x, z, b) with the nuisance states.
    """

    model: Model
    nuisance: NuisanceStates
    y: ca.SX
    active: ca.SX

    def linearise(self, X: ca.SX) -> Outputs:
        """Return the outputs about X, an expression or symbols (n + e, 1)."""
        n, model = self.model.x.numel(), self.model
        loads, variance = self._loads()
        C, h, loads, variance = ca.substitute([ca.jacobian(model.h, model.x), model.h, loads, variance], [model.x], [X[:n, :]])
        return Outputs(ca.horzcat(C, loads), h + loads @ X[n:, :], variance)

    def expect(self, X: ca.SX) -> ExpectedOutputs:
        """Return the outputs at X."""
        n, model = self.model.x.numel(), self.model
        h, loads, variance = ca.substitute([model.h, *self._loads()], [model.x], [X[:n, :]])
        return ExpectedOutputs(h + loads @ X[n:, :], variance)

    def residual(self, expected: ca.SX) -> ca.SX:
        """Return y - expected (q, 1), angles wrapped, 0 for what is not active: an output that is off must not matter."""
        differences = [ca.if_else(self.active[i], self.y[i] - expected[i], 0) for i in range(len(self.model.outputs))]
        return ca.vertcat(*[wrap_if_angle(signal.is_angle, value) for signal, value in zip(self.model.outputs, differences, strict=True)])

    def is_usable(self, rows: ca.SX, residual: ca.SX, variance: ca.SX) -> ca.SX:
        """Return (q, 1): which outputs are active and have finite numbers, so that nan is never taken in."""
        sizes = ca.densify(ca.sum2(ca.fabs(rows)) + ca.fabs(residual) + variance)
        return ca.vertcat(*[ca.logic_and(self.active[i] > 0, sizes[i] < _LARGEST) for i in range(sizes.numel())])

    def _loads(self) -> tuple[ca.SX, ca.SX]:
        """Return how the nuisance states enter the outputs (q, e), and the variance of what is white in them (q, 1)."""
        model, nuisance = self.model, self.nuisance
        # a sample that counts twice is as good as two
        count = ca.if_else(self.active > 0, self.active, 1)
        variance, loads = ca.diag(model.instant_covariance) / count, ca.SX(len(model.outputs), nuisance.size)
        for index, i in enumerate(nuisance.coloured):
            loads[i, index] = ca.sqrt(variance[i])
            variance[i] = 0
        for index, i in enumerate(nuisance.constant):
            loads[i, len(nuisance.coloured) + index] = nuisance.bias[index]
        return loads, ca.densify(variance)


def wrap_if_angle(is_angle: bool, value: ca.SX) -> ca.SX:
    """The value, to [-pi, pi] where it is an angle."""
    return ca.remainder(value, 2 * np.pi) if is_angle else value


def mask_rows(C: ca.SX, is_usable: ca.SX) -> ca.SX:
    """Return C (q, n) with 0 for the rows of outputs that are not usable, not even where these have no derivative."""
    return ca.vertcat(*[ca.if_else(is_usable[i], C[i, :], ca.SX(C[i, :].sparsity(), 0)) for i in range(C.shape[0])])


@dataclass(frozen=True, eq=False)
class SampleInnovations:
    """What is new in the samples of an instant: residual (q, 1), covariance (q, q) that is expected of it, and R (q, 1) of that white.

    is_usable (q, 1): of those that are not, the residual is 0, and the covariance a row of the identity.
    """

    residual: ca.SX
    covariance: ca.SX
    variance: ca.SX
    is_usable: ca.SX

    def is_there(self, outputs: tuple[int, ...]) -> ca.SX:
        """Return whether any of the outputs is usable."""
        return sum((self.is_usable[i] for i in outputs), ca.SX(0)) > 0

    def normalised_square(self, outputs: tuple[int, ...]) -> ca.SX:
        """Return e' S^-1 e of some outputs, by L D L' = S."""
        S, e = ca.densify(self.covariance[list(outputs), list(outputs)]), ca.densify(self.residual[list(outputs)])
        total = ca.SX(0)
        for i in range(len(outputs)):
            total += e[i] ** 2 / S[i, i]
            for j in range(i + 1, len(outputs)):
                ratio = S[j, i] / S[i, i]
                e[j] -= ratio * e[i]
                for k in range(i + 1, len(outputs)):
                    S[j, k] -= ratio * S[i, k]
        return total

    def sufficient_factor(self, output: int, smallest: float) -> ca.SX:
        """Return the factor on P for which the residual of an output is its standard deviation, 1 where it is not above that."""
        of_state = self.covariance[output, output] - self.variance[output]
        excess = (self.residual[output] ** 2 - self.variance[output]) / ca.if_else(of_state > smallest, of_state, 1)
        return ca.fmax(1, ca.if_else(of_state > smallest, excess, 1))
