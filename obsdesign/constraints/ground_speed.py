"""Moving neither too slowly nor too fast over ground."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.arguments import validate_arguments
from obsdesign.constraints._given import SPEED, as_size, format_numbers
from obsdesign.constraints._shapes import smooth_excess
from obsdesign.constraints.abstract import ALWAYS, AbstractConstraint, Coordinate, Moment, Span
from obsdesign.errors import InputError


@validate_arguments
@dataclass(frozen=True)
class GroundSpeed(AbstractConstraint):
    """The speed over ground stays within limits: least <= |(dx/dt, dy/dt)| <= most, wind and current included.

    One margin per limit, (speed - least) / size and (most - speed) / size, with size = (most - least) / 2, or the one limit; rounded
    where the speed is below 0.001 of the limit, so that it has a derivative at rest. Raises InputError for other values.
    """

    least: float | None = None
    """Lower limit [m/s], > 0; None = no limit, not for both."""
    most: float | None = None
    """Upper limit [m/s], > 0; None = no limit."""

    def __post_init__(self) -> None:
        for name, value in (("least", self.least), ("most", self.most)):
            object.__setattr__(self, name, None if value is None else as_size(f"ground_speed: {name}", value))
        if self.least is None and self.most is None:
            raise InputError("ground_speed: least and most are None: must have at least one of them")
        if self.least is not None and self.most is not None and self.least >= self.most:
            raise InputError(f"ground_speed: most is {self.most!r}: must be above least, {self.least!r}")

    def __str__(self) -> str:
        limits = [
            f"{word} {format_numbers(value)}" for word, value in (("at least", self.least), ("at most", self.most)) if value is not None
        ]
        return f"GroundSpeed: {', '.join(limits)} m/s"

    @property
    def span(self) -> Span:
        """At every instant of the path."""
        return ALWAYS

    @property
    def states(self) -> tuple[str, ...]:
        """The position, (x, y), whose rates are the velocity over ground."""
        return ("x", "y")

    @property
    def size(self) -> tuple[float, str]:
        """Half of most - least, or the one limit [m/s]."""
        if self.least is not None and self.most is not None:
            return (self.most - self.least) / 2, SPEED
        return self.least or self.most or 0.0, SPEED

    @property
    def breach(self) -> str:
        """What a path does that breaks it."""
        return "is too slow or too fast"

    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return (speed - least) / size and (most - speed) / size, as far as there are limits; rounded at rest."""
        squared = moment.rate["x"] * moment.rate["x"] + moment.rate["y"] * moment.rate["y"]
        size, _ = self.size
        slow = [] if self.least is None else [smooth_excess(squared, self.least) / size]
        return slow + ([] if self.most is None else [-smooth_excess(squared, self.most) / size])
