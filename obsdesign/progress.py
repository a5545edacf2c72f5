"""What a verb is doing, told while it does it: to whoever asked, and to the logger of its module."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from logging import Logger

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

    def within(self, text: str) -> None:
        """Say what part of a stage is being done: what a verb tells that another one calls, which has told its own logger."""
        if self.progress is not None:
            self.progress(f"  {text}")
