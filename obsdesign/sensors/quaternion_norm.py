"""That a quaternion which stands for an attitude has the norm 1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.arguments import validate_arguments
from obsdesign.sensors._onboard import AbstractOnboard
from obsdesign.signals import Signal

if TYPE_CHECKING:
    import casadi as ca


@validate_arguments
@dataclass(frozen=True, kw_only=True)
class QuaternionNorm(AbstractOnboard):
    """What everybody knows of an attitude, as an output: h = q_t^2 + q_x^2 + q_y^2 + q_z^2.

    Linearised at an estimate with covariance P of q, h is off by trace P in the mean: a sigma below that makes a filter overconfident.
    Source: Martinelli, IROS 2017, eq. 8.
    """

    name: str = "quaternion_norm"

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """One number."""
        return (Signal(self.name, ""),)

    def measure(self, state: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        """Return |q|^2."""
        return (sum((state[name] ** 2 for name in ("q_x", "q_y", "q_z")), state["q_t"] ** 2),)
