"""Power spectral densities of white noise, as users give them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array
from obsdesign.errors import InputError

Numbers = float | tuple[float, ...] | tuple[tuple[float, ...], ...]


@validate_arguments
@dataclass(frozen=True)
class PerSpeed:
    """A power spectral density that grows with the speed: psd |v| + at_rest, |v| the length of (dx/dt, dy/dt).

    In the place of a disturbance_psd or of an entry of input_psd, for what wheels and water do: a variance that grows per metre.
    The speed is that of the states x and y, as known inputs and drift move them. Raises InputError for values that are not finite.
    """

    psd: ArrayLike
    """Per speed, as without: one number of an input, (n,) or (n, n) of the states; the psd's unit per m/s."""
    at_rest: ArrayLike | None = None
    """What is there without moving, as psd one number, (n,) or (n, n), in the unit of one that does not grow; None = nothing."""

    def __post_init__(self) -> None:
        for name in ("psd", "at_rest"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _as_tuples(f"per speed: {name}", value))


DisturbancePsd = ArrayLike | PerSpeed | None
"""Power spectral density (n,) or (n, n) of the process noise [unit^2/s]; None = none."""
InputPsd = Mapping[str, float | PerSpeed] | Sequence[tuple[str, float | PerSpeed]] | None
"""Input -> power spectral density of its white noise [unit^2 s]; None = none. Or pairs of the two."""


def _as_tuples(what: str, value: ArrayLike) -> Numbers:
    """Return numbers as what can be hashed, or raise InputError."""
    array = as_array(what, value)
    if array.ndim > 2 or not np.isfinite(array).all():
        raise InputError(f"{what} is {value!r}: must be finite, one number, (n,) or (n, n)")
    if array.ndim == 0:
        return float(array)
    return tuple(tuple(row) if isinstance(row, list) else row for row in array.tolist())
