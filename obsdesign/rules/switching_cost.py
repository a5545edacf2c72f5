"""What it costs to switch a sensor on."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.rules._given import Sensor, as_numbers
from obsdesign.rules.abstract import AbstractRule, Segments, Terms, per_sensor


@validate_arguments
@dataclass(frozen=True)
class SwitchingCost(AbstractRule):
    """Each switching-on of a sensor takes `cost` off the value of the schedule.

    All sensors are off before the first segment: being on there counts. What starting costs out of a budget is EnergyBudget's `start`.
    Raises InputError for numbers that are negative or not finite.
    """

    cost: float | dict[Sensor, float]
    """In the criterion's unit: one number for every sensor, or a table by sensor."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "cost", as_numbers("switching_cost: cost", self.cost))

    def __str__(self) -> str:
        return "SwitchingCost"

    def terms(self, segments: Segments) -> Terms:
        """Return what each switching-on takes off the value (S,)."""
        return Terms(switching=per_sensor(self, "cost", self.cost, segments))
