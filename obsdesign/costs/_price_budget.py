"""What a cost counts for: a limit, or a price."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_positive
from obsdesign.costs.abstract import AbstractCost
from obsdesign.errors import InputError


@validate_arguments
@dataclass(frozen=True)
class Budget:
    """A limit on what a path may use up: cost <= at_most.

    Raises InputError for other values.
    """

    cost: AbstractCost
    """What is counted, such as PathLength()."""
    at_most: float
    """The largest sum that is accepted, > 0, in the cost's unit."""

    def __post_init__(self) -> None:
        _require_cost("budget: cost", self.cost)
        require_positive("budget: at_most", self.at_most)
        object.__setattr__(self, "at_most", float(self.at_most))

    def __str__(self) -> str:
        return f"{self.cost} at most {self.at_most:g} {self.cost.unit}".rstrip()

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return f"exceeds the budget of {self.cost}"


@validate_arguments
@dataclass(frozen=True)
class Price:
    """What a path pays for what it uses up: the design maximises criterion - per_unit * cost.

    Raises InputError for other values.
    """

    cost: AbstractCost
    """What is counted, such as Effort({"turn_rate": 1.0})."""
    per_unit: float
    """What the criterion loses, in its own unit, for every unit of the cost; > 0."""

    def __post_init__(self) -> None:
        _require_cost("price: cost", self.cost)
        require_positive("price: per_unit", self.per_unit)
        object.__setattr__(self, "per_unit", float(self.per_unit))


def _require_cost(what: str, cost: object) -> None:
    if not isinstance(cost, AbstractCost):
        raise InputError(f"{what} is {cost!r}: must be a cost, such as PathLength()")
