"""What formulas are in CasADi: expressions of the symbols that names stand for, constants folded as fractions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from obsdesign.formulas.exact_values import is_short, whole_power
from obsdesign.formulas.functions import PI
from obsdesign.formulas.tree import AbstractTree, Call, FormulaError, FormulaProblem, Name, Number, Power, Product, Sum

if TYPE_CHECKING:
    import casadi as ca

Value = Any  # Fraction | float | casadi.SX: a constant as it was typed, one that is none, an expression
Values = Mapping[str, Any]  # of a landmark its entries, one Value each


def casadi_value(tree: AbstractTree, values: Values) -> ca.SX:
    """Return a formula as an expression (1, 1); values: what each name stands for, of a landmark its entries.

    Fractions are numbers as they were typed: what is made of them alone is computed without rounding, and rounded once. Raises
    FormulaError for what has no finite value whatever the state, such as 1/0.
    """
    import casadi as ca

    value = value_of(tree, values)
    return value if isinstance(value, ca.SX) else ca.SX(float(value))


def value_of(tree: AbstractTree, values: Values) -> Value:
    """Return the value of a formula: a Fraction, a float, or an expression (1, 1); see `casadi_value`."""
    try:
        value = _value_of(tree, values)
        if isinstance(value, Fraction) and not is_short(value):
            value = float(value)
    except (ZeroDivisionError, ValueError, OverflowError):
        raise FormulaError(FormulaProblem(tree.column, "has no finite value, whatever the state")) from None
    if not _is_finite(value):
        raise FormulaError(FormulaProblem(tree.column, "has no finite value, whatever the state"))
    return value


def _is_finite(value: Value) -> bool:
    """Whether a value is finite in some state, as far as can be told: CasADi folds x/x to 1, so that acos(2*x/x) is a constant."""
    if _is_expression(value):
        return not value.is_constant() or math.isfinite(float(value))
    return isinstance(value, Fraction) or math.isfinite(value)


def _value_of(tree: AbstractTree, values: Values) -> Value:
    match tree:
        case Number():
            return tree.value
        case Name():
            value: Any = math.pi if tree.name == PI else values[tree.name]
            return value if tree.entry is None else value[tree.entry]
        case Sum():
            return _sum_of([value_of(term, values) for term in tree.terms], tree.is_negative)
        case Product():
            return _product_of([value_of(factor, values) for factor in tree.factors], tree.is_divisor)
        case Power():
            return _power_of(value_of(tree.base, values), value_of(tree.exponent, values))
        case Call():
            return _call(tree.function, [value_of(argument, values) for argument in tree.arguments])
    raise TypeError(tree)


def _pair(first: Value, second: Value) -> tuple[Value, Value]:
    """Two values that can be combined: both fractions, both floats, or floats and expressions."""
    if isinstance(first, Fraction) and isinstance(second, Fraction):
        return first, second
    return tuple(float(value) if isinstance(value, Fraction) else value for value in (first, second))  # pyright: ignore[reportReturnType]


def _sum_of(terms: list[Value], is_negative: tuple[bool, ...]) -> Value:
    total = -terms[0] if is_negative[0] else terms[0]
    for term, negative in zip(terms[1:], is_negative[1:], strict=True):
        a, b = _pair(total, term)
        total = a - b if negative else a + b
    return total


def _product_of(factors: list[Value], is_divisor: tuple[bool, ...]) -> Value:
    product = factors[0]
    for factor, divides in zip(factors[1:], is_divisor[1:], strict=True):
        if divides and not _is_expression(factor) and not factor:
            raise ZeroDivisionError
        a, b = _pair(product, factor)
        product = a / b if divides else a * b
    return product


def _power_of(base: Value, exponent: Value) -> Value:
    if isinstance(base, Fraction) and isinstance(exponent, Fraction):
        exact = whole_power(base, exponent)
        if exact is not None:
            return exact
    a, b = _pair(base, exponent)
    if _is_expression(a) or _is_expression(b):
        return _as_expression(a) ** _as_expression(b)
    return math.pow(a, b)


def _call(function: str, arguments: list[Value]) -> Value:
    if any(_is_expression(argument) for argument in arguments):
        return _EXPRESSIONS[function](*[_as_expression(argument) for argument in arguments])
    if function in ("abs", "min", "max"):
        return {"abs": abs, "min": min, "max": max}[function](*arguments)
    return getattr(math, function)(*[float(argument) for argument in arguments])


def _is_expression(value: Value) -> bool:
    return not isinstance(value, (Fraction, float))


def _as_expression(value: Value) -> ca.SX:
    import casadi as ca

    return value if _is_expression(value) else ca.SX(float(value))


def _casadi_function(name: str) -> Callable[..., ca.SX]:
    """The function of CasADi that has a name, loaded when it is called."""

    def call(*arguments: ca.SX) -> ca.SX:
        """Return its value."""
        import casadi as ca

        return getattr(ca, name)(*arguments)

    return call


def _fold(name: str) -> Callable[..., ca.SX]:
    """A function of two arguments, of as many as there are."""
    binary = _casadi_function(name)

    def call(first: ca.SX, *rest: ca.SX) -> ca.SX:
        """Return its value."""
        for argument in rest:
            first = binary(first, argument)
        return first

    return call


def _root_of_squares(*arguments: ca.SX) -> ca.SX:
    """The root of the sum of squares, which has exact counterparts where CasADi's hypot has none."""
    import casadi as ca

    return ca.sqrt(sum((argument**2 for argument in arguments[1:]), arguments[0] ** 2))


_EXPRESSIONS: dict[str, Callable[..., ca.SX]] = {
    **{name: _casadi_function(name) for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sqrt", "exp", "log", "log10")},
    **{name: _casadi_function(name) for name in ("sinh", "cosh", "tanh")},
    "abs": _casadi_function("fabs"),
    "min": _fold("fmin"),
    "max": _fold("fmax"),
    "hypot": _root_of_squares,
}
