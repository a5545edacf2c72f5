"""Times as files write them: seconds, other units, Unix times, ISO 8601."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal

import numpy as np

from obsdesign.errors import InputError
from obsdesign.logs.units import factor_of
from obsdesign.signals import Signal

TIME = Signal("t", "s")
_UNIX = 1e8  # seconds since 1970 from which on a time is taken for one that counts from there: March 1973


@dataclass(frozen=True, eq=False)
class Times:
    """Times (K,) [s], from the Unix time `epoch` [s] where it is not None."""

    t: np.ndarray
    epoch: float | None = None

    @property
    def note(self) -> str:
        """What was done, in words; "" where nothing was."""
        if self.epoch is None:
            return ""
        return f"times are seconds since {datetime.fromtimestamp(self.epoch, UTC):%Y-%m-%d %H:%M:%S} UTC"


def times_of_text(where: str, words: Sequence[str], rows: Sequence[int], unit: str) -> Times:
    """Return the times that words tell, as numbers in a unit or in ISO 8601 (UTC where no zone is named).

    Raises InputError with the row of the first that is neither.
    """
    factor = factor_of(where, TIME, unit)
    numbers, epoch = np.empty(len(words)), None
    if words and not _is_number(words[0]):
        epoch = float(int(_unix_time(f"{where}, line {rows[0]}", words[0])))
    for i, word in enumerate(words):
        place = f"{where}, line {rows[i]}"
        if epoch is not None:
            numbers[i] = _unix_time(place, word, epoch)
        elif _is_number(word):
            numbers[i] = float(word) * factor
        else:
            raise InputError(f"{place}: {word!r} is no time: must be a number, as in the rows before")
    if epoch is not None:
        return Times(numbers, epoch)
    relative = since_start(numbers)
    if relative.epoch is None or not np.isfinite(numbers).all():
        return relative
    # of the digits, as a double of Unix time has a fraction of a microsecond
    scale, start = Decimal(repr(factor)), Decimal(relative.epoch)
    return Times(np.array([float(Decimal(word) * scale - start) for word in words]), relative.epoch)


def since_start(t: np.ndarray) -> Times:
    """Return Unix times as seconds since the whole second before the first of them, other times as they are."""
    if not len(t) or not np.nanmin(t) > _UNIX:
        return Times(t)
    epoch = float(np.floor(np.nanmin(t)))
    return Times(t - epoch, epoch)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _unix_time(place: str, word: str, epoch: float = 0.0) -> float:
    try:
        moment = datetime.fromisoformat(word)
    except ValueError:
        raise InputError(f"{place}: {word!r} is no time: must be a number or a date and time of ISO 8601") from None
    zoned = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    # not as one float: microseconds would be lost
    return (int(zoned.replace(microsecond=0).timestamp()) - epoch) + zoned.microsecond * 1e-6
