"""The values of formulas of numbers alone, as fractions where they are some: constants keep the decimals that were typed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction

from obsdesign.formulas.tree import AbstractTree, Name, Number, Power, Product, Sum

_BITS = 512  # of a fraction: longer ones are rounded


def rational_value(tree: AbstractTree, values: Mapping[str, Fraction] | None = None) -> Fraction | None:
    """Return the value of a formula of numbers, sums, products and whole powers; None for what is no fraction, or has no value."""
    match tree:
        case Number():
            return tree.value
        case Name() if tree.entry is None:
            return (values or {}).get(tree.name)
        case Sum():
            terms = [rational_value(term, values) for term in tree.terms]
            signs = (-1 if negative else 1 for negative in tree.is_negative)
            return None if None in terms else sum((sign * term for sign, term in zip(signs, terms, strict=True) if term), Fraction(0))
        case Product():
            factors = [rational_value(factor, values) for factor in tree.factors]
            return None if None in factors else _product([factor for factor in factors if factor is not None], tree.is_divisor)
        case Power():
            base, exponent = rational_value(tree.base, values), rational_value(tree.exponent, values)
            return None if base is None or exponent is None else whole_power(base, exponent)
    return None


def _product(factors: list[Fraction], is_divisor: tuple[bool, ...]) -> Fraction | None:
    value = Fraction(1)
    for factor, divides in zip(factors, is_divisor, strict=True):
        if divides and not factor:
            return None
        value = value / factor if divides else value * factor
    return value


def whole_power(base: Fraction, exponent: Fraction) -> Fraction | None:
    """Return base^exponent where that is a fraction of reasonable length, else None."""
    if exponent.denominator != 1 or (not base and exponent < 0):
        return None
    length = max(base.numerator.bit_length(), base.denominator.bit_length())
    return base ** int(exponent) if abs(exponent) * max(length - 1, 1) <= _BITS or abs(base) in (0, 1) else None


def is_short(value: Fraction) -> bool:
    """Return whether a fraction is kept as it is."""
    return max(value.numerator.bit_length(), value.denominator.bit_length()) <= _BITS and math.isfinite(value)
