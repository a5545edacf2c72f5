"""The sensors of a model: what they read, and their errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.signals import Point, Signal

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True)
class Noise:
    """The errors of one sensor's samples: e_k = spread_k inflation z_k + constant, z a stationary first-order sequence of variance 1.

    spread: SX (1, 1) of the state, the standard deviation of one sample of each output, or (q, 1) where outputs differ;
    correlation phi in [0, 1): z_0 ~ N(0, 1), z_k = phi z_k-1 + (1 - phi^2)^1/2 white_k from one sample of the sensor to the next,
    for each output its own; bias: standard deviation of the constant error, for each output its own, one number or q; inflation: factor on
    spread of whoever estimates; gate: SX (1, 1), the share of samples that arrive, detection that of those with nothing in the way;
    period: over how long correlation is [s], where time is counted in steps: phi is correlation^(dt / period) over dt there.
    """

    spread: ca.SX
    gate: ca.SX
    inflation: float = 1.0
    bias: float | tuple[float, ...] = 0.0
    correlation: float = 0.0
    detection: float = 1.0
    period: float | None = None

    @property
    def is_white(self) -> bool:
        """Whether the errors of different samples have nothing to do with each other."""
        return not (self.correlation or any(self.biases(1)))

    @property
    def stationary_variance(self) -> ca.SX:
        """(inflation spread)^2, the variance of one sample's first-order part."""
        return (self.inflation * self.spread) ** 2

    @property
    def variance(self) -> ca.SX:
        """R = inflation^2 spread^2 + bias^2 of one sample alone."""
        import casadi as ca

        bias = ca.DM(list(self.bias)) if isinstance(self.bias, tuple) else self.bias
        return self.inflation**2 * self.spread**2 + bias**2

    def biases(self, q: int) -> tuple[float, ...]:
        """Return the standard deviation of the constant error of each of q outputs."""
        return self.bias if isinstance(self.bias, tuple) else (self.bias,) * q


@dataclass(frozen=True)
class Channel:
    """One sensor of a model: outputs h (q, 1) of the state, its noise, rate [Hz] and landmarks [m]."""

    name: str
    outputs: tuple[Signal, ...]
    h: ca.SX
    noise: Noise
    rate: float | None = None
    landmarks: tuple[Point, ...] = ()


@dataclass(frozen=True)
class JointNoise:
    """White errors of several sensors that belong together: covariance (q, q) of their stacked outputs at one instant, as rows.

    sensors: in the order of the stack; before inflation, which multiplies rows and columns. Of those that have a sample at an
    instant, the rows and columns of the others left out. Their channels' spread is the root of the diagonal.
    """

    sensors: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]
