"""What a section of the page is made of."""

from __future__ import annotations

from dataclasses import dataclass

from obsdesign.report.figures._drawing import Picture
from obsdesign.report.table import Table


@dataclass(frozen=True)
class Section:
    """A question with its answer and what backs it; key: its anchor on the page."""

    key: str
    question: str
    answer: str
    pictures: tuple[Picture, ...]
    tables: tuple[Table, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class KeyNumber:
    """A number at the top of the page that stands for the section of that key."""

    part: str
    number: str
    meaning: str
