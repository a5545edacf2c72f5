"""What a sensor is: outputs as functions of named states, their noise, and how often it is read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.checks import require_positive, require_within
from obsdesign.errors import InputError
from obsdesign.signals import Point, Signal

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True, kw_only=True)
class AbstractSensor(ABC):
    """A sensor of one or more outputs. Leaves are final frozen dataclasses, one file each.

    The errors of samples j and k of an output have the covariance

        R_jk = inflation^2 spread_j spread_k correlation^|j - k| + bias_floor^2.

    With scale and bias as states an output is scale h(x) + bias, both constants but for process noise of their own.
    Raises InputError for values outside the ranges below.
    """

    rate: float | None = None
    """Samples per second [Hz]; None = one every step."""
    inflation: float = 1.0
    """What filters and information multiply the spread by, for what the model leaves out; > 0."""
    bias_floor: float = 0.0
    """Standard deviation of a constant error of each output, in its unit; >= 0."""
    correlation: float = 0.0
    """Correlation of the noise of successive samples, in [0, 1)."""
    detection: float = 1.0
    """Share of the samples that arrive where nothing is in the way, in (0, 1]: information counts with it, simulations draw it."""
    scale: str | None = None
    """Name of a state that multiplies the outputs, angles excepted; None = 1. Sensors that name the same state share it."""
    bias: str | None = None
    """Name of a state that is added to the output, of several outputs a state each: the name and what follows the sensor's in the output's
    (`gps_bias_x`, `gps_bias_y`); None = 0. Sensors that name the same state share it."""
    group: str | None = None
    """Name of a thing, such as a landmark, that this sensor is part of: all sensors of a group are one choice and arrive together."""
    name: str = "sensor"
    """What reports, schedules and rules call the sensor."""

    def __post_init__(self) -> None:
        require_sampling(f"{self.name}: ", self.rate, self.inflation, self.bias_floor, self.correlation, self.detection)
        for field in ("scale", "bias", "group"):
            if getattr(self, field) == "":
                raise InputError(f"{self.name}: {field} is '': must be a name")
        if self.scale is not None and all(signal.is_angle for signal in self.outputs):
            raise InputError(f"{self.name}: scale is {self.scale!r}: must be None, an angle that wraps has no scale")

    @property
    @abstractmethod
    def outputs(self) -> tuple[Signal, ...]:
        """Name, unit and wrapping of each output."""

    @property
    @abstractmethod
    def landmarks(self) -> tuple[Point, ...]:
        """Where the things stand that the sensor looks at [m]; outputs may be singular there."""

    @abstractmethod
    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return the noise-free outputs h(x) at the state given by name, with `x_rate`, how fast x changes, unless by what is unknown."""

    @abstractmethod
    def spread(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return the standard deviation of one sample at the state, for all outputs or for each, without inflation and bias."""

    @abstractmethod
    def gate(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return what share of the samples arrives at the state, in (0, 1], smooth."""


def require_sampling(prefix: str, rate: float | None, inflation: float, bias_floor: float, correlation: float, detection: float) -> None:
    """Raise InputError, after a prefix, for what no errors and no samples of a sensor can be like."""
    if rate is not None:
        require_positive(f"{prefix}rate", rate)
    require_positive(f"{prefix}inflation", inflation)
    require_within(f"{prefix}bias_floor", bias_floor)
    require_within(f"{prefix}correlation", correlation, below=1.0)
    require_positive(f"{prefix}detection", detection)
    if detection > 1:
        raise InputError(f"{prefix}detection is {detection!r}: must be at most 1")
