"""How hard the inputs work."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from obsdesign.checks import require_known, require_positive
from obsdesign.costs.abstract import AbstractCost
from obsdesign.errors import InputError
from obsdesign.moment import Coordinate, Moment


@dataclass(frozen=True)
class Effort(AbstractCost):
    """How hard the inputs work: the integral over time of sum_i weight_i u_i^2, without a unit.

    Raises InputError for other values and, when used, for an input that the vehicle does not have.
    """

    weights: tuple[tuple[str, float], ...]
    """Input name -> weight > 0 [1 / (unit of the input^2 s)], as a mapping or as pairs; kept as pairs sorted by name."""

    def __post_init__(self) -> None:
        pairs = _pairs(self.weights)
        names = [name for name, _ in pairs]
        for name, weight in pairs:
            require_positive(f"effort: weight of {name}", weight)
            if names.count(name) > 1:
                raise InputError(f"effort: weights name {name!r} {names.count(name)} times: must name an input once")
        if not pairs:
            raise InputError("effort: weights are empty: must name at least one input")
        object.__setattr__(self, "weights", tuple(sorted((name, float(weight)) for name, weight in pairs)))

    def __str__(self) -> str:
        return f"effort ({' + '.join(f'{weight:g} {name}^2' for name, weight in self.weights)})"

    @property
    def unit(self) -> str:
        """None of its own: the weights carry it."""
        return ""

    def rate(self, moment: Moment) -> Coordinate:
        """Return sum_i weight_i u_i^2, or raise InputError for an input that the vehicle does not have."""
        require_known("effort: the vehicle", [name for name, _ in self.weights], tuple(moment.inputs))
        return sum(weight * (moment.inputs[name] * moment.inputs[name]) for name, weight in self.weights)


def _pairs(weights: Any) -> list[tuple[Any, Any]]:  # noqa: ANN401  # whatever a caller gave
    pairs: list[tuple[Any, Any]]
    try:
        pairs = [(name, weight) for name, weight in (weights.items() if isinstance(weights, Mapping) else weights)]
    except (TypeError, ValueError):
        pairs = [(None, None)]
    if not all(isinstance(name, str) for name, _ in pairs):
        raise InputError(f"effort: weights is {weights!r}: must map names of inputs to weights")
    return pairs
