"""Progress on a terminal: what is being done, and how long it may still take."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import monotonic

_PATIENCE = 2.0  # seconds after which the time left is worth telling
_COUNT = re.compile(r"\s*(\d+) of (\d+) ")
_WIDTH = 100


@contextmanager
def progress_teller(quiet: bool) -> Iterator[Callable[[str], None] | None]:
    """Yield what tells of progress on stderr; None where nobody looks: no terminal there, or asked to be quiet."""
    yield None if quiet or not sys.stderr.isatty() else ProgressLines(lambda line: print(line, file=sys.stderr, flush=True))


@dataclass(frozen=True)
class ProgressLines:
    """Tells of each stage in a line of its own, with the time left where a stage counts what it has done: "50 of 200 ...".

    What is left takes as long for each part as what was done. last: when that count began, how far it came, and when that was said.
    """

    show: Callable[[str], None]
    clock: Callable[[], float] = monotonic
    last: list[tuple[float, int, float]] = field(default_factory=list)

    def __call__(self, text: str) -> None:
        """Tell of a stage, or of a part of one."""
        now, count = self.clock(), _COUNT.match(text)
        began, before, said = self.last.pop() if self.last else (now, 0, now)
        done, total = (int(count[1]), int(count[2])) if count else (0, 0)
        if done <= before:  # another count than that of the last line
            began = said if count else now
        self.last.append((began, done, now))
        self.show((text + _time_left(now - began, done, total))[:_WIDTH])


def _time_left(elapsed: float, done: int, total: int) -> str:
    if elapsed < _PATIENCE or not 0 < done < total:
        return ""
    seconds = elapsed * (total / done - 1)
    return f" ({seconds:.0f} s left)" if seconds < 100 else f" ({seconds / 60:.0f} min left)"
