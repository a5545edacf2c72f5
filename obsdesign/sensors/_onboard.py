"""What sensors share that need nothing outside the vehicle."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.checks import require_positive
from obsdesign.sensors.abstract import AbstractSensor
from obsdesign.signals import Point

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True)
class AbstractOnboard(AbstractSensor, ABC):
    """A sensor that reads the same everywhere."""

    sigma: float
    """Standard deviation of one sample of each output, in its unit ([m] for positions, [rad] for angles); > 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(f"{self.name}: sigma", self.sigma)

    @property
    def landmarks(self) -> tuple[Point, ...]:
        """Nothing is looked at."""
        return ()

    def spread(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return sigma, everywhere."""
        import casadi as ca

        return ca.SX(self.sigma)

    def gate(self, state: Mapping[str, ca.SX]) -> ca.SX:
        """Return 1: every sample arrives."""
        import casadi as ca

        return ca.SX(1)
