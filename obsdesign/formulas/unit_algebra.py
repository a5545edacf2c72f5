"""Units as products of powers of named ones: read from text, multiplied, compared by dimension and by size.

A unit keeps the names that it was written with, so that km/h times h is km; two are compared by what they are in SI base units. Radians
are numbers. Things that are counted (cells, molecules) are dimensions of their own where a table of own units says so.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from obsdesign.formulas.exact_values import rational_value
from obsdesign.formulas.grammar import parse_formula
from obsdesign.formulas.tree import AbstractTree, FormulaError, FormulaProblem, Name, Number, Power, Product

Dimension = tuple[tuple[str, Fraction], ...]
_TOLERANCE = 1e-9  # of the logarithm of a size


@dataclass(frozen=True)
class NamedUnit:
    """A unit with a name of its own: its size in SI base units as a logarithm, and its dimension."""

    name: str
    log_size: float
    dimension: Dimension


@dataclass(frozen=True)
class Unit:
    """A product of powers of named units, in the order in which they were written."""

    powers: tuple[tuple[NamedUnit, Fraction], ...] = ()

    def __mul__(self, factor: Unit) -> Unit:
        """Return the unit of a product."""
        exponents: dict[NamedUnit, Fraction] = {}
        for named, exponent in (*self.powers, *factor.powers):
            exponents[named] = exponents.get(named, Fraction(0)) + exponent
        return Unit(tuple((named, exponent) for named, exponent in exponents.items() if exponent))

    def __pow__(self, exponent: Fraction) -> Unit:
        """Return the unit of a power."""
        return Unit(tuple((named, power * exponent) for named, power in self.powers if power * exponent))

    def __truediv__(self, divisor: Unit) -> Unit:
        """Return the unit of a quotient."""
        return self * divisor ** Fraction(-1)

    @property
    def log_size(self) -> float:
        """Logarithm of its size in SI base units."""
        return math.fsum(named.log_size * exponent for named, exponent in self.powers)

    @property
    def dimension(self) -> Dimension:
        """Powers of the base dimensions, in the order of their names."""
        exponents: dict[str, Fraction] = {}
        for named, power in self.powers:
            for base, exponent in named.dimension:
                exponents[base] = exponents.get(base, Fraction(0)) + power * exponent
        return tuple(sorted((base, exponent) for base, exponent in exponents.items() if exponent))

    def agrees(self, unit: Unit) -> bool:
        """Whether both are one unit, whatever they are called."""
        return self.dimension == unit.dimension and abs(self.log_size - unit.log_size) <= _TOLERANCE

    def __str__(self) -> str:
        above = [_power_text(named.name, exponent) for named, exponent in self.powers if exponent > 0]
        below = [_power_text(named.name, -exponent) for named, exponent in self.powers if exponent < 0]
        numerator = "*".join(above) or "1"
        return numerator if not below else f"{numerator}/{below[0]}" if len(below) == 1 else f"{numerator}/({'*'.join(below)})"


NUMBER = Unit()
"""The unit of what has none."""


def difference_text(unit: Unit, wanted: Unit) -> str:
    """Say by what two units of one dimension differ; nothing where the dimensions differ."""
    if unit.dimension != wanted.dimension:
        return ""
    size = math.exp(min(unit.log_size - wanted.log_size, 600.0))
    return f" (1 {unit} is {size:.4g}{f' {wanted}' if wanted.powers else ''})"


def read_unit(text: str, user_units: Mapping[str, Unit] | None = None) -> Unit:
    """Return the unit of a text such as "kg*m^2/s"; "1" and "-" for numbers. user_units: units by names that are in no table.

    Raises FormulaError for a text that is none, with the nearest name of a unit.
    """
    return NUMBER if text.strip() == "-" else _unit_of(parse_formula(text), user_units or {})


def define_unit(name: str, text: str, user_units: Mapping[str, Unit]) -> Unit:
    """Return a unit with a name of its own: a number of others such as "0.3048 m"; of "" a dimension of its own, a thing that is counted.

    Raises FormulaError.
    """
    if not text.strip():
        return Unit(((NamedUnit(name, 0.0, ((name, Fraction(1)),)), Fraction(1)),))
    number, _, rest = text.strip().partition(" ")
    size = _size_of(number)
    unit = read_unit(text if size is None else rest.strip() or "1", user_units)
    return Unit(((NamedUnit(name, math.log(size or 1.0) + unit.log_size, unit.dimension), Fraction(1)),))


def quantity_of(text: str, user_units: Mapping[str, Unit]) -> tuple[float, str]:
    """Return (number, unit as text) of a text such as "15.5 m/s". Raises FormulaError."""
    number, _, rest = text.strip().partition(" ")
    try:
        value = float(number)
    except ValueError:
        raise FormulaError(FormulaProblem(1, 'must be a number and its unit, such as "15.5 m/s"')) from None
    if rest.strip():
        read_unit(rest, user_units)
    return value, rest.strip()


def _size_of(word: str) -> float | None:
    try:
        size = float(word)
    except ValueError:
        return None
    if not (math.isfinite(size) and size > 0):
        raise FormulaError(FormulaProblem(1, f"is {word}: the size of a unit must be a finite number above 0"))
    return size


def _unit_of(tree: AbstractTree, user_units: Mapping[str, Unit]) -> Unit:
    match tree:
        case Number() if tree.value == 1:
            return NUMBER
        case Name() if tree.entry is None:
            return user_units.get(tree.name) or _named_unit(tree, user_units)
        case Power():
            exponent = rational_value(tree.exponent)
            if exponent is None or abs(exponent) > _LARGEST_EXPONENT:
                raise FormulaError(
                    FormulaProblem(tree.exponent.column, f"an exponent of a unit must be a fraction of at most {_LARGEST_EXPONENT}")
                )
            return _unit_of(tree.base, user_units) ** exponent
        case Product():
            unit = NUMBER
            for factor, divides in zip(tree.factors, tree.is_divisor, strict=True):
                unit = unit / _unit_of(factor, user_units) if divides else unit * _unit_of(factor, user_units)
            return unit
    raise FormulaError(FormulaProblem(tree.column, "is no unit: must be a product of powers of units, such as kg*m^2/s, or 1"))


_LARGEST_EXPONENT = 20


def _named_unit(name: Name, user_units: Mapping[str, Unit]) -> Unit:
    symbol = name.name.replace("µ", "u").replace("μ", "u")
    if symbol in _UNITS:
        return Unit(((_UNITS[symbol], Fraction(1)),))
    for length in (1, 2):
        prefix, rest = symbol[:length], symbol[length:]
        if prefix in _PREFIXES and rest in _WITH_PREFIX:
            base = _UNITS[rest]
            return Unit(((NamedUnit(symbol, base.log_size + _PREFIXES[prefix] * math.log(10), base.dimension), Fraction(1)),))
    accepted = (*user_units, *_UNITS)
    near = difflib.get_close_matches(name.name, accepted, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    listed = f"accepted: {', '.join(accepted)}; with SI prefixes"
    message = f'there is no unit {name.name!r}{hint} ({listed}; one of your own stands in units = {{ {name.name} = "" }})'
    raise FormulaError(FormulaProblem(name.column, message, accepted, near[0] if near else None))


def _power_text(name: str, exponent: Fraction) -> str:
    if exponent == 1:
        return name
    return f"{name}^{exponent}" if exponent.denominator == 1 else f"{name}^({exponent})"


_PREFIXES = {
    "Q": 30, "R": 27, "Y": 24, "Z": 21, "E": 18, "P": 15, "T": 12, "G": 9, "M": 6, "k": 3, "h": 2, "da": 1,
    "d": -1, "c": -2, "m": -3, "u": -6, "n": -9, "p": -12, "f": -15, "a": -18, "z": -21, "y": -24, "r": -27, "q": -30,
}  # fmt: skip
_BASES = ("m", "kg", "s", "A", "K", "mol", "cd")
# with prefixes: name -> size and base units
_SI: dict[str, tuple[float, str]] = {
    "g": (1e-3, "kg"), "Hz": (1, "s^-1"), "N": (1, "kg m s^-2"), "Pa": (1, "kg m^-1 s^-2"), "J": (1, "kg m^2 s^-2"),
    "W": (1, "kg m^2 s^-3"), "C": (1, "A s"), "V": (1, "kg m^2 s^-3 A^-1"), "F": (1, "kg^-1 m^-2 s^4 A^2"),
    "Ohm": (1, "kg m^2 s^-3 A^-2"), "S": (1, "kg^-1 m^-2 s^3 A^2"), "Wb": (1, "kg m^2 s^-2 A^-1"), "T": (1, "kg s^-2 A^-1"),
    "H": (1, "kg m^2 s^-2 A^-2"), "L": (1e-3, "m^3"), "l": (1e-3, "m^3"), "M": (1e3, "mol m^-3"), "bar": (1e5, "kg m^-1 s^-2"),
    "eV": (1.602176634e-19, "kg m^2 s^-2"), "rad": (1, ""), "cal": (4.184, "kg m^2 s^-2"), "t": (1e3, "kg"),
}  # fmt: skip
# without
_MORE: dict[str, tuple[float, str]] = {
    "deg": (math.pi / 180, ""), "rev": (2 * math.pi, ""), "rpm": (2 * math.pi / 60, "s^-1"), "percent": (1e-2, ""),
    "min": (60, "s"), "h": (3600, "s"), "day": (86400, "s"), "week": (604800, "s"), "year": (31557600, "s"),
    "inch": (0.0254, "m"), "ft": (0.3048, "m"), "yd": (0.9144, "m"), "mi": (1609.344, "m"), "nmi": (1852, "m"),
    "kn": (1852 / 3600, "m s^-1"), "mph": (1609.344 / 3600, "m s^-1"), "gn": (9.80665, "m s^-2"),
    "lb": (0.45359237, "kg"), "lbf": (4.4482216152605, "kg m s^-2"), "psi": (6894.757293168, "kg m^-1 s^-2"),
    "atm": (101325, "kg m^-1 s^-2"), "mmHg": (133.322387415, "kg m^-1 s^-2"), "ha": (1e4, "m^2"),
}  # fmt: skip


def _dimension(text: str) -> Dimension:
    pairs = (word.partition("^") for word in text.split())
    return tuple(sorted((base, Fraction(exponent or 1)) for base, _, exponent in pairs))


_UNITS = {base: NamedUnit(base, 0.0, _dimension(base)) for base in _BASES}
_UNITS |= {name: NamedUnit(name, math.log(size), _dimension(text)) for name, (size, text) in {**_SI, **_MORE}.items()}
_WITH_PREFIX = frozenset({"m", "s", "A", "K", "mol", "cd", *_SI})
RADIAN = Unit(((_UNITS["rad"], Fraction(1)),))
"""The unit of an angle, which is a number."""
