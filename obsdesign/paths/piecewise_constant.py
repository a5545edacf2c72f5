"""Inputs held over pieces of equal length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.checks import require_count
from obsdesign.errors import InputError
from obsdesign.paths.abstract import AbstractPath

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np


@dataclass(frozen=True)
class PiecewiseConstant(AbstractPath):
    """u_k = p_j for every step k of piece j; `pieces` equal pieces, each a whole number of steps."""

    pieces: int

    def __post_init__(self) -> None:
        require_count("pieces", self.pieces)

    def rows(self, steps: int) -> int:
        if steps % self.pieces:
            raise InputError(f"pieces is {self.pieces}: must divide the number of steps, {steps}")
        return self.pieces

    def inputs(self, p: ca.SX, steps: int) -> ca.SX:
        length = steps // self.rows(steps)
        return p[[k // length for k in range(steps)], :]

    def fit(self, u: np.ndarray) -> np.ndarray:
        return u.reshape(self.rows(len(u)), -1, u.shape[1]).mean(axis=1)
