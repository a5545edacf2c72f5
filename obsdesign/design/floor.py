"""Information that every stretch of a path must have."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_positive


@validate_arguments
@dataclass(frozen=True)
class Floor:
    """No part of the path hides the state: lambda_min(S W S) of every stretch is at least `value`, W about the state at its beginning.

    Stretches begin every half of their length.
    """

    seconds: float
    """Length of a stretch [s]."""
    value: float
    """The least smallest eigenvalue, in scaled states."""

    def __post_init__(self) -> None:
        require_positive("floor: seconds", self.seconds)
        require_positive("floor: value", self.value)

    def __str__(self) -> str:
        return f"Floor: lambda_min of every {self.seconds:g} s at least {self.value:g}"

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return "sees too little for a while, falling short"
