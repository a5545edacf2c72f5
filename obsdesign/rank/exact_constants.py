"""The numbers of an expression as symbols with exact values: CasADi would round them while it differentiates.

Angles are taken apart: what is known of a node is `expression + turns pi`, and sine and cosine of a multiple of pi / 12 are
numbers, so that sin(x + pi) is -sin(x), and cos(x) at x = pi / 2 is 0 and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import casadi as ca

from obsdesign.rank.balls import OPERATIONS, irrational_part
from obsdesign.rank.exact_numbers import ExactNumber, cosine, negate, pi_times, sine
from obsdesign.rank.graph import Ring, evaluate, instructions


@dataclass(frozen=True, eq=False)
class SymbolisedExpression:
    """An expression whose constants but 0 and +-1 are symbols (k, 1) with exact values: differentiating rounds none.

    readings: the doubles that stood there, each with what it stands for.
    """

    expression: ca.SX
    constants: ca.SX
    values: tuple[ExactNumber, ...]
    readings: tuple[tuple[float, ExactNumber], ...]


def symbolise(
    x: ca.SX, expression: ca.SX, reading: Callable[[float], ExactNumber], origin: Sequence[Fraction] | None = None
) -> SymbolisedExpression:
    """Return the dense expression of x (n, 1) with a symbol for every constant.

    reading: what a double stands for; origin (n,): x stands for x + origin pi, multiples of pi / 12.
    CasADi works on constants in double precision while it differentiates: x / 3 / 49 would get the gradient 0.00680...,
    and exact arithmetic would then prove a wrong rank.
    """
    steps = instructions(ca.Function("expression", [x], [ca.densify(expression)]))
    table = _SymbolTable()
    numbers = _ConstantReader(table, reading)
    origins: Sequence[Fraction] = origin or [Fraction(0)] * x.numel()
    states = [_AngleNode(symbol, multiple_of_pi) for symbol, multiple_of_pi in zip(ca.vertsplit(x), origins, strict=True)]
    ring = Ring(numbers, {operation: _AngleOperation(operation, table) for operation in OPERATIONS})
    entries = [table.expression_of(node) for node in evaluate(steps, [states], ring)]
    symbols = ca.vertcat(ca.SX(0, 1), *table.symbols.values())
    return SymbolisedExpression(
        ca.reshape(ca.vertcat(*entries), *expression.shape), symbols, tuple(table.symbols), tuple(sorted(table.readings.items()))
    )


@dataclass(frozen=True)
class NodeOperation:
    """An operation on expressions: one more node of the graph."""

    operation: int

    def __call__(self, a: ca.SX, b: ca.SX | None = None) -> ca.SX:
        return ca.SX.unary(self.operation, a) if b is None else ca.SX.binary(self.operation, a, b)


@dataclass(frozen=True, eq=False)
class _AngleNode:
    """The value expression + turns pi; turns is a multiple of 1/12, factor the number that it is, if it is one."""

    expression: ca.SX
    multiple_of_pi: Fraction = Fraction(0)
    factor: Fraction | None = None


@dataclass(frozen=True, eq=False)
class _SymbolTable:
    """The symbols that stand for numbers, and what doubles stand for."""

    symbols: dict[ExactNumber, ca.SX] = field(default_factory=dict[ExactNumber, ca.SX])
    readings: dict[float, ExactNumber] = field(default_factory=dict[float, ExactNumber])

    def symbol(self, number: ExactNumber) -> ca.SX:
        """Return what stands for the number in an expression."""
        if number in (0, 1, -1):
            return ca.SX(float(number))
        return self.symbols.setdefault(number, ca.SX.sym(f"constant {len(self.symbols)}"))

    def expression_of(self, node: _AngleNode) -> ca.SX:
        """Return the node as an expression."""
        return node.expression + self.symbol(pi_times(node.multiple_of_pi)) if node.multiple_of_pi else node.expression


@dataclass(frozen=True)
class _ConstantReader:
    """What a constant of a graph becomes."""

    table: _SymbolTable
    reading: Callable[[float], ExactNumber]

    def __call__(self, value: float) -> _AngleNode:
        if not math.isfinite(value) or irrational_part(value):
            return _AngleNode(ca.SX(value))
        number = self.table.readings.setdefault(value, self.reading(value))
        if isinstance(number, Fraction):
            return _AngleNode(self.table.symbol(number), factor=number)
        multiple_of_pi = number.multiple_of_pi
        if multiple_of_pi is None:
            return _AngleNode(self.table.symbol(number))
        twelfths = Fraction(math.floor(12 * multiple_of_pi), 12)
        return _AngleNode(self.table.symbol(pi_times(multiple_of_pi - twelfths)), twelfths)


@dataclass(frozen=True)
class _AngleOperation:
    """An operation on nodes."""

    code: int
    table: _SymbolTable

    def __call__(self, a: _AngleNode, b: _AngleNode | None = None) -> _AngleNode:
        is_angle = b is not None and b.multiple_of_pi
        angle_rule = _ANGLE_RULES.get(self.code) if a.multiple_of_pi or is_angle else None
        node = angle_rule(self.table, a, b or _AngleNode(ca.SX(0))) if angle_rule else None
        if node:
            return node
        first = self.table.expression_of(a)
        if b is None:
            return _AngleNode(ca.SX.unary(self.code, first))
        return _AngleNode(ca.SX.binary(self.code, first, self.table.expression_of(b)))


def _product(a: _AngleNode, b: _AngleNode) -> _AngleNode | None:
    """Return an angle times a number where that is an angle again."""
    angle, number = (a, b) if b.factor is not None else (b, a)
    if number.factor is None or (12 * number.factor * angle.multiple_of_pi).denominator != 1:
        return None
    return _AngleNode(a.expression * b.expression, number.factor * angle.multiple_of_pi)


def _quotient(a: _AngleNode, b: _AngleNode) -> _AngleNode | None:
    if not b.factor or (12 * a.multiple_of_pi / b.factor).denominator != 1:
        return None
    return _AngleNode(a.expression / b.expression, a.multiple_of_pi / b.factor)


def _sine(table: _SymbolTable, angle: _AngleNode) -> ca.SX:
    """sin(rest + a) = sin(rest) cos(a) + cos(rest) sin(a)."""
    remainder, twelfths = angle.expression, int(12 * angle.multiple_of_pi)
    return ca.sin(remainder) * table.symbol(cosine(twelfths)) + ca.cos(remainder) * table.symbol(sine(twelfths))


def _cosine(table: _SymbolTable, angle: _AngleNode) -> ca.SX:
    """cos(rest + a) = cos(rest) cos(a) - sin(rest) sin(a)."""
    remainder, twelfths = angle.expression, int(12 * angle.multiple_of_pi)
    return ca.cos(remainder) * table.symbol(cosine(twelfths)) + ca.sin(remainder) * table.symbol(negate(sine(twelfths)))


def _tangent(table: _SymbolTable, angle: _AngleNode) -> ca.SX:
    return ca.tan(angle.expression) if angle.multiple_of_pi.denominator == 1 else _sine(table, angle) / _cosine(table, angle)


_ANGLE_RULES: Mapping[int, Callable[[_SymbolTable, _AngleNode, _AngleNode], _AngleNode | None]] = {
    ca.OP_ADD: lambda _, a, b: _AngleNode(a.expression + b.expression, a.multiple_of_pi + b.multiple_of_pi),
    ca.OP_SUB: lambda _, a, b: _AngleNode(a.expression - b.expression, a.multiple_of_pi - b.multiple_of_pi),
    ca.OP_NEG: lambda _, a, __: _AngleNode(-a.expression, -a.multiple_of_pi),
    ca.OP_TWICE: lambda _, a, __: _AngleNode(ca.SX.unary(ca.OP_TWICE, a.expression), 2 * a.multiple_of_pi),
    ca.OP_MUL: lambda _, a, b: _product(a, b),
    ca.OP_DIV: lambda _, a, b: _quotient(a, b),
    ca.OP_SIN: lambda table, a, _: _AngleNode(_sine(table, a)),
    ca.OP_COS: lambda table, a, _: _AngleNode(_cosine(table, a)),
    ca.OP_TAN: lambda table, a, _: _AngleNode(_tangent(table, a)),
}
"""What is done to angles that are known up to a multiple of pi / 12; None where the result is no such angle."""
