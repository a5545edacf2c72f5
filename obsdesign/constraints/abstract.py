"""What a constraint is: numbers that must not be negative while it holds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from obsdesign.moment import Coordinate, Moment


@dataclass(frozen=True)
class Span:
    """When a constraint holds: from `first` to `last` [s]; None = the end of the path. anywhere: at one instant of it, not at all."""

    first: float | None = 0.0
    last: float | None = None
    anywhere: bool = False


ALWAYS, AT_END = Span(), Span(None, None)


class AbstractConstraint(ABC):
    """A limit on a path. Leaves are final frozen dataclasses, one file each; str() of one is how messages call it.

    Margins are >= 0 where the constraint holds, without unit, of order 1 near its edge, growing in proportion to distance, not to
    its square; smooth where they are small.
    """

    @property
    @abstractmethod
    def span(self) -> Span:
        """When it must hold."""

    @property
    @abstractmethod
    def states(self) -> tuple[str, ...]:
        """Names of the states that the margins need."""

    @property
    @abstractmethod
    def size(self) -> tuple[float, str]:
        """What a margin of 1 is worth, and its unit: (3.0, "m")."""

    @property
    @abstractmethod
    def breach(self) -> str:
        """What a path does that breaks it, as a predicate: "misses the goal"; by how much follows."""

    @abstractmethod
    def margins(self, moment: Moment) -> list[Coordinate]:
        """Return the margins at a moment; the number of them depends on the landmarks alone."""
