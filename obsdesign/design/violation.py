"""What a path breaks: which limit, when and by how much, as facts; words are made of them here and in the report."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.costs._price_budget import Budget
from obsdesign.design.floor import Floor
from obsdesign.signals import Signal


class ViolationKind(Enum):
    """What kind of limit is broken."""

    CONSTRAINT = "constraint"
    """A constraint along the path or at its end."""
    START = "constraint at the start"
    """A constraint that the given start is beyond: nothing can be done about it."""
    INPUT_BOUND = "bound of an input"
    """The range of an input."""
    INPUT_RATE = "rate of an input"
    """How fast an input may change."""
    BUDGET = "budget"
    """What a path may use up."""
    FLOOR = "floor"
    """What every stretch of a path must see."""


@dataclass(frozen=True)
class InputBound:
    """The range of an input: lower <= u <= upper."""

    signal: Signal
    """The input."""
    lower: float
    """The least that it may be, in its unit."""
    upper: float
    """The most that it may be, in its unit."""

    def __str__(self) -> str:
        return f"{self.signal.name} within {self.lower:g} to {self.upper:g} {self.signal.unit}"

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return f"leaves the bounds of {self.signal.name.replace('_', ' ')}"


@dataclass(frozen=True)
class InputRate:
    """How fast an input may change: |du/dt| <= at_most."""

    signal: Signal
    """The input."""
    at_most: float
    """The largest rate, in `unit`."""

    def __str__(self) -> str:
        return f"{self.signal.name} changing by at most {self.at_most:g} {self.unit}"

    @property
    def unit(self) -> str:
        """The input's unit per second."""
        return f"{self.signal.unit}/s"

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return f"changes {self.signal.name.replace('_', ' ')} too fast"


# each is named by str() and says in `breach` what a path does that breaks it
Limit = AbstractConstraint | InputBound | InputRate | Budget | Floor


@dataclass(frozen=True)
class Violation:
    """One limit that a path breaks."""

    constraint: Limit
    """The limit itself."""
    kind: ViolationKind
    """What kind of limit it is."""
    time: float
    """When it is broken most [s]."""
    by: float
    """By how much, in `unit`."""
    unit: str
    """Unit of `by`."""
    margin: float
    """The constraint's own margin there: < 0, of order 1."""

    def __str__(self) -> str:
        return f"{self.what}: missed by {self.by:.3g}{' ' * bool(self.unit)}{self.unit} at {self.time:.4g} s"

    @property
    def what(self) -> str:
        """The limit in words."""
        return str(self.constraint)
