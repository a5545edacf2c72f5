"""What a verb is doing, told while it does it: to whoever asked, and to the logger of its module."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from logging import Logger
from typing import TypeVar

Result = TypeVar("Result")
Progress = Callable[[str], None]  # is called with what is being done, in words, as each stage begins


@dataclass(frozen=True)
class StageReport:
    """Tells of each stage as it begins: a logger, at level INFO, and `progress`, None = nobody."""

    logger: Logger
    progress: Progress | None = None

    def __call__(self, stage: str) -> None:
        """Say what is being done."""
        self.logger.info(stage)
        if self.progress is not None:
            self.progress(stage)

    def count(self, results: Iterable[Result], total: int, what: str, done: int = 0) -> Iterator[Result]:
        """Yield results as they come, and say how many there are: "3 of 8 climbs done", from which the time left follows.

        done: how many there were before.
        """
        for number, result in enumerate(results, done + 1):
            if total > 1:
                self(f"{number} of {total} {what}")
            yield result

    def within(self, text: str) -> None:
        """Say what part of a stage is being done: what a verb tells that another one calls, which has told its own logger."""
        if self.progress is not None:
            self.progress(f"  {text}")
