"""When a call has to end: one moment, fixed as it is entered and handed down."""

from __future__ import annotations

from dataclasses import dataclass
from time import monotonic

from obsdesign.checks import require_positive


@dataclass(frozen=True)
class Deadline:
    """The moment after which only what has to be done is done, on the monotonic clock [s]; inf = never."""

    end: float = float("inf")

    @property
    def is_over(self) -> bool:
        """Whether it has passed."""
        return monotonic() >= self.end

    @property
    def seconds_left(self) -> float | None:
        """Seconds until then, 1e-3 at least; None = any number."""
        return None if self.end == float("inf") else max(1e-3, self.end - monotonic())

    def leaves(self, seconds: float) -> bool:
        """Whether there are so many seconds left."""
        return monotonic() + seconds < self.end

    def share(self, part: float) -> Deadline:
        """Return the moment at which so much of what is left has gone by."""
        return self if self.seconds_left is None else Deadline(monotonic() + part * max(0.0, self.end - monotonic()))


NEVER = Deadline()
"""No deadline: only the work is limited."""


def deadline_after(time_limit: float | None) -> Deadline:
    """Return the deadline in so many seconds from now, None = never; raise InputError for a limit that is not above 0."""
    if time_limit is None:
        return NEVER
    require_positive("time_limit", time_limit)
    return Deadline(monotonic() + time_limit)
