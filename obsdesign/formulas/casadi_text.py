"""CasADi expressions as text, in the grammar of formulas, where that is short enough to be read."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import NamedTuple

import casadi as ca

from obsdesign.errors import InputError
from obsdesign.formulas.tree import AbstractTree, Call, Name, Number, Power, Product, Sum
from obsdesign.formulas.writing import write_formula
from obsdesign.rank.graph import Ring, evaluate, instructions

_LARGEST = 60  # nodes of a formula that is shown
_ONE, _TWO = Number(Fraction(1)), Number(Fraction(2))


class _Sized(NamedTuple):
    """A formula and how many nodes it has."""

    tree: AbstractTree
    size: int


def formulas_of(expression: ca.SX, symbols: ca.SX, names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the entries (n, 1) of an expression as formulas; None where one is too long, or has an operation that formulas lack.

    symbols (r, 1): what it is made of; names: what each of them is called.
    """
    graph = ca.Function("formulas", [symbols], [ca.densify(expression)])
    arguments = [_Sized(Name(name), 1) for name in names]
    try:
        values = evaluate(instructions(graph), [arguments], Ring(_constant, _OPERATIONS))
    except InputError:
        return None
    return tuple(write_formula(value.tree) for value in values)


def _constant(value: float) -> _Sized:
    if not math.isfinite(value):
        raise InputError(f"the constant {value} is no number")
    number = Number(Fraction(repr(abs(value))))
    return _Sized(Sum((number,), (True,)) if value < 0 else number, 1)


def _operation_of(build: Callable[..., AbstractTree]) -> Callable[..., _Sized]:
    """The operation that makes a formula of formulas, while it is short."""

    def operation(*parts: _Sized) -> _Sized:
        """Return the formula."""
        size = 1 + sum(part.size for part in parts)
        if size > _LARGEST:
            raise InputError("the formula is too long to be read")
        return _Sized(build(*(part.tree for part in parts)), size)

    return operation


def _sum(first: AbstractTree, second: AbstractTree, negative: bool = False) -> AbstractTree:
    terms, signs = (first.terms, first.is_negative) if isinstance(first, Sum) else ((first,), (False,))
    more, more_signs = (second.terms, second.is_negative) if isinstance(second, Sum) else ((second,), (False,))
    return Sum((*terms, *more), (*signs, *(sign != negative for sign in more_signs)))


def _product(first: AbstractTree, second: AbstractTree, divides: bool = False) -> AbstractTree:
    if not divides and isinstance(second, Power) and second.base == first and isinstance(second.exponent, Number):
        return Power(first, Number(second.exponent.value + 1))  # a cube is a square times its base
    factors, flags = (first.factors, first.is_divisor) if isinstance(first, Product) else ((first,), (False,))
    more, more_flags = (second.factors, second.is_divisor) if isinstance(second, Product) and not divides else ((second,), (divides,))
    return Product((*factors, *more), (*flags, *more_flags))


def _function(name: str) -> Callable[..., _Sized]:
    return _operation_of(lambda *arguments: Call(name, arguments))


_OPERATIONS: dict[int, Callable[..., _Sized]] = {
    ca.OP_ADD: _operation_of(_sum),
    ca.OP_SUB: _operation_of(lambda a, b: _sum(a, b, negative=True)),
    ca.OP_MUL: _operation_of(_product),
    ca.OP_DIV: _operation_of(lambda a, b: _product(a, b, divides=True)),
    ca.OP_NEG: _operation_of(lambda a: Sum((a,), (True,))),
    ca.OP_INV: _operation_of(lambda a: _product(_ONE, a, divides=True)),
    ca.OP_SQ: _operation_of(lambda a: Power(a, _TWO)),
    ca.OP_TWICE: _operation_of(lambda a: _product(_TWO, a)),
    ca.OP_POW: _operation_of(Power),
    ca.OP_CONSTPOW: _operation_of(Power),
    ca.OP_FABS: _function("abs"),
    ca.OP_FMIN: _function("min"),
    ca.OP_FMAX: _function("max"),
    ca.OP_HYPOT: _function("hypot"),
    **{
        getattr(ca, f"OP_{name.upper()}"): _function(name)
        for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log", "sqrt")
    },
}
