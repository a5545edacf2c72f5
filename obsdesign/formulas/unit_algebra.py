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
from obsdesign.formulas.named_units import PREFIXES, UNITS, WITH_PREFIX, Dimension, NamedUnit, pint_unit
from obsdesign.formulas.tree import AbstractTree, FormulaError, FormulaProblem, Name, Number, Power, Product

_TOLERANCE = 1e-9  # of the logarithm of a size


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
    """The unit of a name: of the table, with a prefix, or of pint, which takes half a second to load and knows a thousand."""
    symbol = name.name.replace("µ", "u").replace("μ", "u")
    if symbol in UNITS:
        return Unit(((UNITS[symbol], Fraction(1)),))
    for length in (1, 2):
        prefix, rest = symbol[:length], symbol[length:]
        if prefix in PREFIXES and rest in WITH_PREFIX:
            base = UNITS[rest]
            return Unit(((NamedUnit(symbol, base.log_size + PREFIXES[prefix] * math.log(10), base.dimension), Fraction(1)),))
    unit = pint_unit(name.name)
    if unit is not None:
        return Unit(((unit, Fraction(1)),))
    accepted = (*user_units, *UNITS)
    near = difflib.get_close_matches(name.name, accepted, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    listed = f"accepted: {', '.join(accepted)}, with SI prefixes, and those of pint"
    message = f'there is no unit {name.name!r}{hint} ({listed}; one of your own stands in units = {{ {name.name} = "" }})'
    raise FormulaError(FormulaProblem(name.column, message, accepted, near[0] if near else None))


def _power_text(name: str, exponent: Fraction) -> str:
    if exponent == 1:
        return name
    return f"{name}^{exponent}" if exponent.denominator == 1 else f"{name}^({exponent})"


RADIAN = Unit(((UNITS["rad"], Fraction(1)),))
"""The unit of an angle, which is a number."""
