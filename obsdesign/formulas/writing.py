"""Trees as text, with as few brackets as the grammar needs."""

from __future__ import annotations

from fractions import Fraction

from obsdesign.formulas.grammar import AXES
from obsdesign.formulas.tree import AbstractTree, Call, Name, Number, Power, Product, Sum

_SUM, _PRODUCT, _FACTOR, _ATOM = range(4)  # what binds how strongly


def write_formula(tree: AbstractTree) -> str:
    """Return the text of a formula; `parse_formula` makes an equal tree of it."""
    return _text(tree)[0]


def write_number(value: Fraction) -> str:
    """Return a number as decimals where it has some, else as a quotient."""
    number = float(value)
    text = f"{number:.15g}"
    if Fraction(text) != value:
        text = repr(number)
    if Fraction(text) != value:
        return f"{value.numerator}/{value.denominator}"
    return text.replace("e+", "e")


def _text(tree: AbstractTree) -> tuple[str, int]:
    """The text of a tree, and how strongly it binds."""
    match tree:
        case Number():
            text = write_number(tree.value)
            return text, _SUM if text.startswith("-") else _PRODUCT if "/" in text else _ATOM
        case Name():
            return (tree.name if tree.entry is None else f"{tree.name}{_entry_text(tree.entry)}"), _ATOM
        case Call():
            return f"{tree.function}({', '.join(_text(argument)[0] for argument in tree.arguments)})", _ATOM
        case Power():
            return f"{_within(tree.base, _ATOM)}^{_within(tree.exponent, _FACTOR)}", _FACTOR
        case Product():
            pairs = zip(tree.factors[1:], tree.is_divisor[1:], strict=True)
            rest = "".join(("/" if divides else "*") + _within(factor, _FACTOR) for factor, divides in pairs)
            return _within(tree.factors[0], _FACTOR) + rest, _PRODUCT
        case Sum():
            return _sum_text(tree), _SUM
    raise TypeError(tree)


def _sum_text(tree: Sum) -> str:
    first = ("-" if tree.is_negative[0] else "") + _within(tree.terms[0], _PRODUCT)
    pairs = zip(tree.terms[1:], tree.is_negative[1:], strict=True)
    return first + "".join((" - " if negative else " + ") + _within(term, _PRODUCT) for term, negative in pairs)


def _within(tree: AbstractTree, least: int) -> str:
    """The text of a part, in brackets where it binds less strongly than is needed."""
    text, strength = _text(tree)
    return text if strength >= least else f"({text})"


def _entry_text(entry: int) -> str:
    return f".{AXES[entry]}" if entry < len(AXES) else f"[{entry}]"
