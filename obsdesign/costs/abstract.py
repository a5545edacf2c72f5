"""What a cost is: a number that adds up along a path."""

from __future__ import annotations

from abc import ABC, abstractmethod

from obsdesign.moment import Coordinate, Moment


class AbstractCost(ABC):
    """The integral of a rate over time along a path. Leaves are final frozen dataclasses, one file each; str() names one."""

    @property
    @abstractmethod
    def unit(self) -> str:
        """Unit of the sum."""

    @abstractmethod
    def rate(self, moment: Moment) -> Coordinate:
        """Return the cost per second at a moment, elementwise, smooth."""
