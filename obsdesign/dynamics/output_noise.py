"""How well, how often and when an output of a system of one's own is measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_pair, require_positive
from obsdesign.dynamics.channel import Noise
from obsdesign.sensors.abstract import require_sampling
from obsdesign.signals import Point

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, eq=False)
class OutputNoise:
    """The errors of one output, a sensor, and when its samples come: all that ready-made sensors have.

    The errors of samples j and k have the covariance R_jk = inflation^2 sigma_j sigma_k correlation^|j - k| + bias_floor^2.
    Raises InputError for values outside the ranges below.
    """

    sigma: float | tuple[float, ...] | ca.SX = 1.0
    """Standard deviation of one sample in the unit of the output, > 0, of a vector also one for each entry (q,); or an expression > 0 of
    the state, (1, 1) or (q, 1)."""
    gate: ca.SX | None = None
    """Share of the samples that arrive, an expression (1, 1) of the state in (0, 1], without a unit; None = 1."""
    rate: float | None = None
    """Samples per second [Hz]; None = one every step."""
    inflation: float = 1.0
    """What filters and information multiply the spread by, for what the model leaves out; > 0."""
    bias_floor: float | tuple[float, ...] = 0.0
    """Standard deviation of a constant error of each entry, in its unit, or one for each entry (q,); >= 0."""
    correlation: float = 0.0
    """Correlation of the noise of successive samples, in [0, 1)."""
    detection: float = 1.0
    """Share of the samples that arrive where nothing is in the way, in (0, 1]: information counts with it, simulations draw it."""
    landmarks: tuple[Point, ...] = ()
    """Where the things stand that the sensor looks at, (x, y) each [m]; outputs may be singular there."""

    def __post_init__(self) -> None:
        for sigma in self.sigmas or ():
            require_positive("sigma", sigma)
        if isinstance(self.bias_floor, list):
            object.__setattr__(self, "bias_floor", tuple(self.bias_floor))
        for bias_floor in self.bias_floor if isinstance(self.bias_floor, tuple) else (self.bias_floor,):
            require_sampling("", self.rate, self.inflation, bias_floor, self.correlation, self.detection)
        object.__setattr__(self, "landmarks", tuple(as_pair("landmarks", point) for point in self.landmarks))

    @property
    def sigmas(self) -> tuple[float, ...] | None:
        """Sigma as numbers, one or one for each entry; None where it is an expression."""
        if isinstance(self.sigma, tuple | list):
            return tuple(self.sigma)
        return (float(self.sigma),) if isinstance(self.sigma, Real) else None

    @property
    def expressions(self) -> tuple[ca.SX, ...]:
        """Those of sigma and gate that are expressions."""
        return (*(() if self.sigmas is not None else (self.sigma,)), *(() if self.gate is None else (self.gate,)))  # pyright: ignore[reportReturnType]

    @property
    def numbers(self) -> tuple[object, ...]:
        """All but the expressions, and whether there is a gate: with these what two equal noises share."""
        numbers = (self.rate, self.inflation, self.bias_floor, self.correlation, self.detection, self.landmarks)
        return (self.sigmas, self.gate is not None, *numbers)

    @property
    def noise(self) -> Noise:
        """The noise of the output in a model."""
        import casadi as ca

        sigma = ca.SX(self.sigma if self.sigmas is None else ca.DM(list(self.sigmas)))
        gate = ca.SX(1) if self.gate is None else ca.SX(self.gate)
        share = gate if self.detection == 1 else self.detection * gate
        return Noise(sigma, share, self.inflation, self.bias_floor, self.correlation, self.detection)


def noise_from(numbers: tuple[Any, ...], expressions: Iterator[ca.SX]) -> OutputNoise:
    """Return the noise of which those were the numbers, its expressions the next of many."""
    sigmas, has_gate, rate, inflation, bias_floor, correlation, detection, landmarks = numbers
    sigma = next(expressions) if sigmas is None else sigmas
    return OutputNoise(sigma, next(expressions) if has_gate else None, rate, inflation, bias_floor, correlation, detection, landmarks)
