"""Times of a log between which nothing came: told where they are long, refused where a clock must have been set in between."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from obsdesign.errors import InputError

_CLOCK = 1e6  # s: no drive pauses for so long
_SHARE = 0.99  # of the log's time that such a pause takes
_LONG, _TIMES = 10.0, 100.0  # a gap that is told is longer than so many seconds, and than so many others


class _Placed(Protocol):
    """Values of a file at times t (K,) [s], each with its place in words."""

    @property
    def t(self) -> np.ndarray:
        """Times (K,) [s]."""
        ...

    def place(self, row: int) -> str:
        """Return where a value stands."""
        ...


def gap_notes(file: Path, series: Sequence[_Placed]) -> tuple[str, ...]:
    """Return in words the longest time in which neither an input nor a sample came, where it is long beside the others.

    Raises InputError where nearly all of the log's time is one gap of weeks: its clock was set in between.
    """
    times = np.unique(np.concatenate([part.t for part in series])) if series else np.zeros(0)
    gaps = np.diff(times)
    if not len(gaps):
        return ()
    longest = int(np.argmax(gaps))
    before, after, gap = times[longest], times[longest + 1], gaps[longest]
    if gap > _CLOCK and gap > _SHARE * (times[-1] - times[0]):
        part = next(part for part in series if (part.t == after).any())
        raise InputError(
            f"{file}, {part.place(int(np.argmax(part.t == after)))}: t = {after:.9g} s is {gap:.3g} s after all that came before it,"
            f" to {before:.9g} s: was the clock set in between? A log's times count from one instant"
        )
    many = gaps > max(_LONG, _TIMES * float(np.median(gaps)))
    if not many.any():
        return ()
    others = f", the longest of {int(many.sum())} gaps" if many.sum() > 1 else ""
    return (f"nothing came from t = {before:.6g} to {after:.6g} s{others}: inputs that are held go on over that time",)
