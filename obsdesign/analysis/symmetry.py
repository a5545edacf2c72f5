"""A change of the state that moves no output, from any state: the reason why a direction is hidden."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from obsdesign.signals import Point


class SymmetryKind(Enum):
    """What a change that moves no output is; the value says it in words."""

    UNSEEN = "a state by itself"
    SHIFT = "a common shift"
    ROTATION = "a rotation of everything"
    SCALE = "a scale of everything"
    SUM = "constants that only occur in a sum"
    PRODUCT = "factors that only occur in a product"
    FORCING = "a state whose share of the rates constant forcing can take"
    MOTION = "a shift along the motion"
    LINEAR = "a linear change of several states"


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A vector field that annihilates what is known of the state, everywhere: who moves along it, however far, changes no output."""

    kind: SymmetryKind
    """What it is."""
    states: tuple[str, ...]
    """Names of the states that change."""
    vector: np.ndarray
    """The field (n,) at the state `at` of the verdict."""
    A: np.ndarray | None = None
    """The field is A x + b, A (n, n); None where it is not affine."""
    b: np.ndarray | None = None
    """The field is A x + b, b (n,); None where it is not affine."""
    centre: Point | None = None
    """What is turned or scaled about (x, y) [m]; None = the origin, or no such thing."""
    motion: str = ""
    """What moves the state along it: "drift", "known input" or "unknown input"; of MOTION alone."""

    def without(self, is_asked: Sequence[bool]) -> Symmetry:
        """Return the symmetry of the states that are asked about; the others, which are seen, do not change."""
        rows, left_out = np.flatnonzero(is_asked), np.flatnonzero(~np.asarray(is_asked))
        is_affine = self.A is not None and self.b is not None and not self.A[:, left_out].any()
        A = self.A[np.ix_(rows, rows)] if is_affine and self.A is not None else None
        return replace(self, vector=self.vector[rows], A=A, b=self.b[rows] if is_affine and self.b is not None else None)
