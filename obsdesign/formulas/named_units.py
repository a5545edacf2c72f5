"""The units that have names: SI, and those of navigation and of laboratories; the others are asked of pint."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

Dimension = tuple[tuple[str, Fraction], ...]


@dataclass(frozen=True)
class NamedUnit:
    """A unit with a name of its own: its size in SI base units as a logarithm, and its dimension."""

    name: str
    log_size: float
    dimension: Dimension


PREFIXES = {
    "Q": 30, "R": 27, "Y": 24, "Z": 21, "E": 18, "P": 15, "T": 12, "G": 9, "M": 6, "k": 3, "h": 2, "da": 1,
    "d": -1, "c": -2, "m": -3, "u": -6, "n": -9, "p": -12, "f": -15, "a": -18, "z": -21, "y": -24, "r": -27, "q": -30,
}  # fmt: skip
"""Powers of ten."""
BASES = ("m", "kg", "s", "A", "K", "mol", "cd")
"""The units that all others are made of."""
# with prefixes: name -> size and base units
_SI: dict[str, tuple[float, str]] = {
    "g": (1e-3, "kg"), "Hz": (1, "s^-1"), "N": (1, "kg m s^-2"), "Pa": (1, "kg m^-1 s^-2"), "J": (1, "kg m^2 s^-2"),
    "W": (1, "kg m^2 s^-3"), "C": (1, "A s"), "V": (1, "kg m^2 s^-3 A^-1"), "F": (1, "kg^-1 m^-2 s^4 A^2"),
    "Ohm": (1, "kg m^2 s^-3 A^-2"), "S": (1, "kg^-1 m^-2 s^3 A^2"), "Wb": (1, "kg m^2 s^-2 A^-1"), "T": (1, "kg s^-2 A^-1"),
    "H": (1, "kg m^2 s^-2 A^-2"), "L": (1e-3, "m^3"), "l": (1e-3, "m^3"), "M": (1e3, "mol m^-3"), "bar": (1e5, "kg m^-1 s^-2"),
    "rad": (1, ""),
}  # fmt: skip
# without
_MORE: dict[str, tuple[float, str]] = {
    "deg": (math.pi / 180, ""), "rev": (2 * math.pi, ""), "rpm": (2 * math.pi / 60, "s^-1"), "percent": (1e-2, ""),
    "min": (60, "s"), "h": (3600, "s"), "day": (86400, "s"), "week": (604800, "s"), "year": (31557600, "s"),
    "ft": (0.3048, "m"), "nmi": (1852, "m"), "kn": (1852 / 3600, "m s^-1"), "mph": (1609.344 / 3600, "m s^-1"), "gn": (9.80665, "m s^-2"),
}  # fmt: skip


def _dimension(text: str) -> Dimension:
    pairs = (word.partition("^") for word in text.split())
    return tuple(sorted((base, Fraction(exponent or 1)) for base, _, exponent in pairs))


UNITS = {base: NamedUnit(base, 0.0, _dimension(base)) for base in BASES}
"""By name."""
UNITS |= {name: NamedUnit(name, math.log(size), _dimension(text)) for name, (size, text) in {**_SI, **_MORE}.items()}
WITH_PREFIX = frozenset({"m", "s", "A", "K", "mol", "cd", *_SI})
"""Names that may have a prefix."""
_BASES_OF_PINT = {"meter": "m", "kilogram": "kg", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol", "candela": "cd"}


@lru_cache(2**8)
def pint_unit(name: str) -> NamedUnit | None:
    """Return a unit that pint knows by this name; None where it does not, or where 0 of it is not 0 (degrees Celsius, decibels)."""
    import pint

    registry = _registry()
    try:
        zero, one = (registry.Quantity(value, name).to_base_units() for value in (0.0, 1.0))
    except (pint.PintError, AttributeError, ValueError, AssertionError, KeyError, TypeError):
        return None
    if zero.magnitude != 0 or not one.magnitude > 0:
        return None
    powers = [(_BASES_OF_PINT.get(str(base), str(base)), Fraction(power).limit_denominator(1000)) for base, power in one.unit_items()]
    dimension = tuple(sorted((base, power) for base, power in powers if base != "radian"))
    return NamedUnit(name, math.log(one.magnitude), dimension)


@lru_cache(1)
def _registry() -> Any:  # noqa: ANN401  # of a package that is loaded when it is asked
    import pint

    return pint.UnitRegistry()
