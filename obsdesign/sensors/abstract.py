"""What a sensor is: outputs as functions of named states, their noise, and how often it is read."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from obsdesign.checks import require_positive
from obsdesign.signals import Point, Signal

if TYPE_CHECKING:
    import casadi as ca


class AbstractSensor(ABC):
    """A sensor of one or more outputs. Leaves are final frozen dataclasses, one file each.

    sigma: standard deviation of one sample of each output, in the output's unit.
    rate [Hz]: samples per second, None = every step; name: what reports call it.
    """

    sigma: float
    rate: float | None
    name: str

    def __post_init__(self) -> None:
        require_positive(f"{self.name}: sigma", self.sigma)
        if self.rate is not None:
            require_positive(f"{self.name}: rate", self.rate)

    @property
    @abstractmethod
    def outputs(self) -> tuple[Signal, ...]:
        """Name, unit and wrapping of each output."""

    @property
    @abstractmethod
    def landmark(self) -> Point | None:
        """Where the thing stands that the sensor looks at [m], or None; outputs may be singular there."""

    @abstractmethod
    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return the noise-free outputs h(x) at the state given by name."""


def distinct_names(sensors: Sequence[AbstractSensor]) -> tuple[str, ...]:
    """Return the sensors' names, the second of one name numbered: range, range_2."""
    names = [sensor.name for sensor in sensors]
    earlier = [names[:i].count(name) for i, name in enumerate(names)]
    return tuple(f"{name}_{count + 1}" if count else name for name, count in zip(names, earlier, strict=True))
