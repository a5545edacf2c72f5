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
    """cost <= at_most, in the cost's unit, > 0. Raises InputError for other values."""

    cost: AbstractCost
    at_most: float

    def __post_init__(self) -> None:
        _require_cost("budget: cost", self.cost)
        require_positive("budget: at_most", self.at_most)
        object.__setattr__(self, "at_most", float(self.at_most))


@validate_arguments
@dataclass(frozen=True)
class Price:
    """The criterion loses per_unit, in its own unit, > 0, for every unit of the cost. Raises InputError for other values."""

    cost: AbstractCost
    per_unit: float

    def __post_init__(self) -> None:
        _require_cost("price: cost", self.cost)
        require_positive("price: per_unit", self.per_unit)
        object.__setattr__(self, "per_unit", float(self.per_unit))


def _require_cost(what: str, cost: object) -> None:
    if not isinstance(cost, AbstractCost):
        raise InputError(f"{what} is {cost!r}: must be a cost, such as PathLength()")
