"""What a rule is: what it forbids, what it counts, and what it takes off the value of a schedule."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from obsdesign.checks import require_count, require_known
from obsdesign.errors import InputError

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True, eq=False)
class Segments:
    """What rules know of the K segments and S sensors of a schedule."""

    names: tuple[str, ...]
    """Names of the S sensors, by which rules may speak of them."""
    count: int
    """Number K of segments."""
    t: np.ndarray | None = None
    """Where segments begin and end (K+1,) [s]; None = not known: rules that need it then raise InputError."""
    tracks: tuple[np.ndarray, ...] | None = None
    """Positions (., 2) [m] in each segment, K arrays; None = not known: rules that need them then raise InputError."""

    def sensor(self, rule: object, sensor: str | int) -> int:
        """Return the index of a sensor given by name or index, or raise InputError."""
        if isinstance(sensor, str):
            require_known(f"{rule}: sensors", (sensor,), self.names)
            return self.names.index(sensor)
        require_count(f"{rule}: sensor", sensor, minimum=0, maximum=len(self.names) - 1)
        return int(sensor)

    def sensors(self, rule: object, sensors: tuple[str | int, ...] | None) -> tuple[int, ...]:
        """Return the indices of sensors, None = all of them."""
        return tuple(range(len(self.names))) if sensors is None else tuple(self.sensor(rule, sensor) for sensor in sensors)


@dataclass(frozen=True, eq=False)
class Resource:
    """sum_k sum_s usage_ks on_ks + sum of start_s over every time that s is switched on <= limit; usage (K, S), start (S,), all >= 0."""

    usage: np.ndarray
    start: np.ndarray
    limit: float


@dataclass(frozen=True, eq=False)
class Terms:
    """What a rule says; what it leaves at None it does not touch.

    available (K, S) bool; sensors: the sensors that `admissible` looks at, which says of patterns (P, S) bool which may be on
    together; resource: what is counted; switching (S,): what each switching-on takes off the value; dwell (S,): segments that a
    sensor stays on at least.
    """

    available: np.ndarray | None = None
    sensors: tuple[int, ...] = ()
    admissible: Callable[[np.ndarray], np.ndarray] | None = None
    resource: Resource | None = None
    switching: np.ndarray | None = None
    dwell: np.ndarray | None = None


class AbstractRule(ABC):
    """A rule for schedules. Leaves are final frozen dataclasses, one file each; str() of one is how messages call it."""

    @abstractmethod
    def terms(self, segments: Segments) -> Terms:
        """Return what the rule says about these segments, or raise InputError for a sensor or a segment that they do not have."""


def per_sensor(rule: object, what: str, value: float | dict[str | int, float], segments: Segments) -> np.ndarray:
    """Return one number >= 0 per sensor (S,) of one for all, or of a table by sensor (0 for those it leaves out)."""
    import numpy as np

    table = value if isinstance(value, dict) else dict.fromkeys(range(len(segments.names)), value)
    numbers = np.zeros(len(segments.names))
    for sensor, number in table.items():
        numbers[segments.sensor(rule, sensor)] = number
    if not (np.isfinite(numbers).all() and (numbers >= 0).all()):
        raise InputError(f"{rule}: {what} is {value!r}: every number must be finite and at least 0")
    return numbers
