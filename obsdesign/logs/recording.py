"""What the files of autopilots and robots hold: topics of many fields, of which a map picks some."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from obsdesign.checks import require_known
from obsdesign.display import AbstractDisplay, MissingPackageError, Summary, number


@dataclass(frozen=True, eq=False)
class Topic:
    """Messages of one kind: times (K,) [s] and the numbers (K,) of each field."""

    name: str
    """Its name in the file."""
    t: np.ndarray
    """Times (K,) [s] of the messages."""
    fields: Mapping[str, np.ndarray]
    """Numbers (K,) of each field, in the file's units, nan where a message has none."""
    rows: np.ndarray | None = None
    """Where the messages stand in the file (K,); None = one after the other."""

    @property
    def rate(self) -> float:
        """Messages per second [Hz], nan for less than two."""
        span = float(self.t[-1] - self.t[0]) if len(self.t) > 1 else 0.0
        return (len(self.t) - 1) / span if span > 0 else float("nan")


@dataclass(frozen=True, eq=False)
class Recording(AbstractDisplay):
    """What is in a file: its topics, the Unix time [s] that times count from, and what a row of it is called."""

    file: Path
    """The file."""
    format: str
    """Its format, in words."""
    topics: Mapping[str, Topic]
    """Topics by name."""
    epoch: float | None = None
    """Unix time [s] of the instant that times count from; None = not known."""
    row_word: str = "message"
    """What the file's rows are called."""
    notes: tuple[str, ...] = field(default=())
    """What was done to its numbers."""

    def topic(self, name: str) -> Topic:
        """Return the topic of that name; raise InputError with those that the file has."""
        require_known(f"{self.file}", [name], list(self.topics))
        return self.topics[name]

    @property
    def table(self) -> list[dict[str, object]]:
        """A row for each topic: name, number of messages, first and last time [s], rate [Hz], fields."""
        return [
            {
                "topic": topic.name,
                "messages": len(topic.t),
                "first": float(topic.t[0]) if len(topic.t) else None,
                "last": float(topic.t[-1]) if len(topic.t) else None,
                "rate": None if np.isnan(topic.rate) else topic.rate,
                "fields": list(topic.fields),
            }
            for topic in self.topics.values()
        ]

    def _summary(self) -> Summary:
        rows = [
            (topic.name, f"{len(topic.t)} times, {number(topic.rate, 'Hz')}: {', '.join(topic.fields)}") for topic in self.topics.values()
        ]
        return Summary(f"{self.file.name}: {self.format}, {len(self.topics)} topics", tuple(rows))


def missing_package(package: str, extra: str, format_name: str) -> MissingPackageError:
    """Return the error for a format whose reader is not installed."""
    return MissingPackageError(f"{format_name} is read by {package}, which is not installed: pip install 'obsdesign[{extra}]'")
