"""Refusing bad values with one sentence that names the thing, the value and what is accepted."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from obsdesign.errors import InputError


def require_positive(what: str, value: float) -> None:
    """Raise InputError unless 0 < value < inf."""
    if not (isinstance(value, (int, float)) and math.isfinite(value) and value > 0):
        raise InputError(f"{what} is {value!r}: must be a finite number above 0")


def require_finite(what: str, values: Sequence[float]) -> None:
    """Raise InputError unless every value is finite."""
    for value in values:
        if not math.isfinite(value):
            raise InputError(f"{what} is {tuple(values)!r}: every entry must be finite")


def require_count(what: str, value: int, least: int = 1, most: int | None = None) -> None:
    """Raise InputError unless value is a whole number in [least, most]."""
    whole = isinstance(value, int) or (hasattr(value, "__index__") and not isinstance(value, bool))
    if not whole or value < least or (most is not None and value > most):
        accepted = f"a whole number of at least {least}" if most is None else f"a whole number from {least} to {most}"
        raise InputError(f"{what} is {value!r}: must be {accepted}")


def require_known(what: str, names: Collection[str], accepted: Sequence[str]) -> None:
    """Raise InputError for the first name that is not among the accepted ones, with the nearest spelling."""
    import difflib

    for name in names:
        if name not in accepted:
            near = difflib.get_close_matches(name, accepted, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise InputError(f"{what} has no {name!r}{hint} (accepted: {', '.join(accepted) or 'none'})")


def whole_multiple(length: float, unit: float) -> int | None:
    """Return length / unit where that is a whole number (to 1e-9), else None."""
    ratio = length / unit
    nearest = round(ratio)
    return nearest if nearest >= 1 and abs(ratio - nearest) <= 1e-9 * max(1.0, ratio) else None
