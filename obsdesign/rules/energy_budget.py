"""An energy, or any other cost, for the whole path."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_within
from obsdesign.rules._given import Sensor, as_numbers
from obsdesign.rules.abstract import AbstractRule, Resource, Segments, Terms, per_sensor


@validate_arguments
@dataclass(frozen=True)
class EnergyBudget(AbstractRule):
    """What being on and switching on may take in all is limited.

    sum_k sum_s cost_s on_ks + sum of start_s over every switching-on <= limit.
    Raises InputError for numbers that are negative or not finite.
    """

    limit: float
    """The most that may be spent, in any unit, the same one for all three."""
    cost: float | dict[Sensor, float]
    """Per segment that a sensor is on: one number for every sensor, or a table by sensor (0 for those it leaves out)."""
    start: float | dict[Sensor, float] = 0.0
    """Each time a sensor is switched on, also in the first segment, in the limit's unit: one number, or a table by sensor."""

    def __post_init__(self) -> None:
        require_within("energy_budget: limit", self.limit)
        object.__setattr__(self, "cost", as_numbers("energy_budget: cost", self.cost))
        object.__setattr__(self, "start", as_numbers("energy_budget: start", self.start))

    def __str__(self) -> str:
        return f"EnergyBudget of {self.limit:g}"

    def terms(self, segments: Segments) -> Terms:
        """Return the resource sum_k sum_s cost_s on_ks + sum of start_s per switching-on <= limit."""
        cost, start = per_sensor(self, "cost", self.cost, segments), per_sensor(self, "start", self.start, segments)
        usage = cost[None].repeat(segments.count, axis=0)
        return Terms(resource=Resource(usage, start, float(self.limit)))
