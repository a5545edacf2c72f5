"""Refusing bad values with one sentence that names the thing, the value and what is accepted."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

from obsdesign.errors import InputError

if TYPE_CHECKING:
    import numpy as np


def _is_finite_number(value: Any) -> bool:  # noqa: ANN401  # whatever a caller gave
    if type(value) is not float and (isinstance(value, bool) or not isinstance(value, Real)):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond all floats
        return False


def require_positive(what: str, value: float) -> None:
    """Raise InputError unless 0 < value < inf."""
    if not (_is_finite_number(value) and value > 0):
        raise InputError(f"{what} is {value!r}: must be a finite number above 0")


def require_finite(what: str, value: Any) -> None:  # noqa: ANN401  # whatever a caller gave
    """Raise InputError unless value is a finite number."""
    if not _is_finite_number(value):
        raise InputError(f"{what} is {value!r}: must be a finite number")


def require_within(what: str, value: Any, below: float = math.inf) -> None:  # noqa: ANN401  # whatever a caller gave
    """Raise InputError unless value is a finite number in [0, below)."""
    if not (_is_finite_number(value) and 0 <= float(value) < below):
        upper = "" if below == math.inf else f" and below {below:g}"
        raise InputError(f"{what} is {value!r}: must be a finite number of at least 0{upper}")


def require_tolerance(value: Any) -> None:  # noqa: ANN401  # whatever a caller gave
    """Raise InputError unless 0 < tolerance < 1."""
    if not (_is_finite_number(value) and 0 < value < 1):
        raise InputError(f"tolerance is {value!r}: must be a number above 0 and below 1, the relative error that steps may have")


def as_array(what: str, value: Any) -> np.ndarray:  # noqa: ANN401  # whatever a caller took for numbers
    """Return a new array of floats, or raise InputError for what is none: words, rows of unequal length, complex numbers."""
    import numpy as np

    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value.copy()
    try:
        array = np.array(value)
        if array.dtype.kind not in "biuf":
            # objects: fractions, whole numbers of any length; None would become nan
            numbers = array.dtype.kind == "O" and all(isinstance(entry, Real) for entry in array.flat)
            array = array.astype(float) if numbers else None
    except (TypeError, ValueError, OverflowError, NotImplementedError):
        array = None
    if array is None:
        shown = repr(value)
        raise InputError(f"{what} is {shown if len(shown) <= 60 else shown[:57] + '...'}: must be an array of real numbers")
    return array.astype(float)


def all_finite(values: np.ndarray) -> bool:
    """Return whether no entry is inf or nan."""
    import numpy as np

    # the sum takes a third of the time, and says no only where it overflows itself
    with np.errstate(over="ignore", invalid="ignore"):
        return math.isfinite(np.add.reduce(values, axis=None)) or bool(np.isfinite(values).all())


def as_pair(what: str, values: Any) -> tuple[float, float]:  # noqa: ANN401  # whatever a caller took for a pair
    """Return two finite numbers, such as a point (x, y) or an interval (low, high), as a tuple, or raise InputError."""
    pair = tuple(values) if isinstance(values, Iterable) else (values,)
    if len(pair) != 2 or not all(isinstance(value, Real) for value in pair):
        raise InputError(f"{what} is {values!r}: must be two numbers")
    first, second = (float(value) for value in pair)
    if not (math.isfinite(first) and math.isfinite(second)):
        raise InputError(f"{what} is {(first, second)!r}: every entry must be finite")
    return first, second


def require_count(what: str, value: int, minimum: int = 1, maximum: int | None = None) -> None:
    """Raise InputError unless value is a whole number in [least, most]."""
    is_whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not is_whole or value < minimum or (maximum is not None and value > maximum):
        accepted = f"a whole number of at least {minimum}" if maximum is None else f"a whole number from {minimum} to {maximum}"
        raise InputError(f"{what} is {value!r}: must be {accepted}")


def require_divisor(what: str, value: int, whole: str, of: int) -> None:
    """Raise InputError unless value is a whole number of at least 1 that divides `of`, the number of `whole`."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < 1 or of % value:
        raise InputError(f"{what} is {value!r}: must divide the number of {whole}, {of}")


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
