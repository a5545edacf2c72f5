"""The mathematics of SBML as formulas of ours."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

from obsdesign.errors import InputError
from obsdesign.formulas.functions import PI
from obsdesign.formulas.grammar import DEEPEST
from obsdesign.formulas.tree import AbstractTree, Call, Name, Number, Power, Product, Sum

# functions of one or more arguments that are called the same, or otherwise, in formulas
_FUNCTIONS = {
    f"FUNCTION_{word}": name
    for word, name in {
        "EXP": "exp", "LN": "log", "ABS": "abs", "SIN": "sin", "COS": "cos", "TAN": "tan", "ARCSIN": "asin", "ARCCOS": "acos",
        "ARCTAN": "atan", "SINH": "sinh", "COSH": "cosh", "TANH": "tanh", "MIN": "min", "MAX": "max",
    }.items()
}  # fmt: skip


def tree_of(node: Any, names: Mapping[str, str], depth: int = 0) -> AbstractTree:  # noqa: ANN401  # of a package that is optional
    """Return a formula of a node of libsbml; names: what identifiers are called in formulas. Raises InputError for what formulas lack."""
    import libsbml

    if depth > DEEPEST:
        raise InputError(f"has more than {DEEPEST} operations within one another")
    kind = node.getType()
    parts = [tree_of(node.getChild(i), names, depth + 1) for i in range(node.getNumChildren())]
    if node.isNumber():
        return _number(node)
    if kind == libsbml.AST_NAME:
        return Name(names.get(node.getName(), node.getName()))
    if kind == libsbml.AST_NAME_TIME:
        return Name(names[TIME])
    if kind == libsbml.AST_CONSTANT_PI:
        return Name(PI)
    if kind == libsbml.AST_CONSTANT_E:
        return Call("exp", (Number(Fraction(1)),))
    operation = _operation(kind, parts)
    if operation is None:
        shown = libsbml.formulaToL3String(node)
        raise InputError(f"contains {shown[:60] if shown else 'something'!r}, which formulas do not have (piecewise, delays, comparisons)")
    return operation


TIME = "time"
"""What time is called among names."""


def _number(node: Any) -> AbstractTree:  # noqa: ANN401
    import libsbml

    if node.getType() == libsbml.AST_RATIONAL:
        value = Fraction(node.getNumerator(), node.getDenominator())
    elif node.isInteger():
        value = Fraction(node.getInteger())
    else:
        value = Fraction(repr(float(node.getReal())))
    return Number(value) if value >= 0 else Sum((Number(-value),), (True,))


def _operation(kind: int, parts: list[AbstractTree]) -> AbstractTree | None:
    """The formula of an operation; None where formulas do not have it."""
    import libsbml

    word = next((word for word in (*_OPERATIONS, *_FUNCTIONS) if kind == getattr(libsbml, f"AST_{word}")), None)
    if word in _OPERATIONS:
        return _OPERATIONS[word](parts)
    if word in ("FUNCTION_MIN", "FUNCTION_MAX") and len(parts) == 1:
        return parts[0]
    return None if word is None else Call(_FUNCTIONS[word], tuple(parts))


def _difference(parts: list[AbstractTree]) -> AbstractTree:
    return Sum((parts[0],), (True,)) if len(parts) == 1 else Sum(tuple(parts), (False, True))


def _root(parts: list[AbstractTree]) -> AbstractTree:
    """root(degree, x)."""
    return Call("sqrt", (parts[1],)) if parts[0] == Number(Fraction(2)) else Power(parts[1], _quotient([Number(Fraction(1)), parts[0]]))


def _logarithm(parts: list[AbstractTree]) -> AbstractTree:
    """log(base, x)."""
    return _quotient([Call("log", (parts[1],)), Call("log", (parts[0],))])


def _quotient(parts: list[AbstractTree]) -> AbstractTree:
    return Product(tuple(parts), (False, True))


def _power(parts: list[AbstractTree]) -> AbstractTree:
    return Power(parts[0], parts[1])


def _series(parts: list[AbstractTree], neutral: Fraction) -> AbstractTree:
    """Parts that are added, or multiplied where nothing is neutral but 1; none, one or many."""
    if len(parts) < 2:
        return parts[0] if parts else Number(neutral)
    first, rest = parts[0], tuple(parts[1:])
    signs = (False,) * len(rest)
    if neutral:
        factors, divides = (first.factors, first.is_divisor) if isinstance(first, Product) else ((first,), (False,))
        return Product((*factors, *rest), (*divides, *signs))
    terms, negative = (first.terms, first.is_negative) if isinstance(first, Sum) else ((first,), (False,))
    return Sum((*terms, *rest), (*negative, *signs))


_OPERATIONS: dict[str | None, Callable[[list[AbstractTree]], AbstractTree]] = {
    "PLUS": lambda parts: _series(parts, Fraction(0)),
    "TIMES": lambda parts: _series(parts, Fraction(1)),
    "MINUS": _difference,
    "DIVIDE": _quotient,
    "POWER": _power,
    "FUNCTION_POWER": _power,
    "FUNCTION_ROOT": _root,
    "FUNCTION_LOG": _logarithm,
}
