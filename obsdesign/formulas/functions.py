"""The functions that formulas may contain, and what units they take and give."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Units(Enum):
    """What a function does with units."""

    OF_NUMBERS = "arguments without a unit, or radians; a number"
    OF_ANGLES = "an angle in radians; a number"
    TO_ANGLE = "a number; an angle in radians"
    RATIO_TO_ANGLE = "two arguments of one unit; an angle in radians"
    SAME = "arguments of one unit; the same unit"
    ROOT = "any unit; its root"


@dataclass(frozen=True)
class Function:
    """How many arguments a function takes, and what it does with units."""

    fewest: int
    largest: int
    units: Units

    @property
    def count(self) -> str:
        """How many arguments, in words."""
        if self.fewest != self.largest:
            return f"{self.fewest} or more arguments"
        return "1 argument" if self.fewest == 1 else f"{self.fewest} arguments"


LARGEST = 100
"""Of arguments."""
FUNCTIONS = {
    **dict.fromkeys(("sin", "cos", "tan"), Function(1, 1, Units.OF_ANGLES)),
    **dict.fromkeys(("asin", "acos", "atan"), Function(1, 1, Units.TO_ANGLE)),
    "atan2": Function(2, 2, Units.RATIO_TO_ANGLE),
    **dict.fromkeys(("exp", "log", "log10", "sinh", "cosh", "tanh"), Function(1, 1, Units.OF_NUMBERS)),
    "sqrt": Function(1, 1, Units.ROOT),
    "abs": Function(1, 1, Units.SAME),
    "hypot": Function(2, LARGEST, Units.SAME),
    "min": Function(2, LARGEST, Units.SAME),
    "max": Function(2, LARGEST, Units.SAME),
}
"""By name."""
ALIASES = {"ln": "log", "arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2"}
"""What is read as another function."""
PI = "pi"
"""The name that stands for a number."""
RESERVED = frozenset({*FUNCTIONS, *ALIASES, PI})
"""Names that nothing else may bear."""
