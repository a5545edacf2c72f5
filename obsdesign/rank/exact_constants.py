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
from obsdesign.rank.exact_numbers import Meaning, cosine, negative, of_pi, sine
from obsdesign.rank.graph import Ring, evaluate, instructions


@dataclass(frozen=True, eq=False)
class Symbolised:
    """An expression whose constants but 0 and +-1 are symbols (k, 1) with exact values: differentiating rounds none.

    read: the doubles that stood there, each with what it stands for.
    """

    expression: ca.SX
    constants: ca.SX
    values: tuple[Meaning, ...]
    read: tuple[tuple[float, Meaning], ...]


def symbolise(x: ca.SX, expression: ca.SX, meaning: Callable[[float], Meaning], origin: Sequence[Fraction] | None = None) -> Symbolised:
    """Return the dense expression of x (n, 1) with a symbol for every constant.

    meaning: what a double stands for; origin (n,): x stands for x + origin pi, multiples of pi / 12.
    CasADi works on constants in double precision while it differentiates: x / 3 / 49 would get the gradient 0.00680...,
    and exact arithmetic would then prove a wrong rank.
    """
    steps = instructions(ca.Function("expression", [x], [ca.densify(expression)]))
    table = _Table()
    numbers = _Numbers(table, meaning)
    every: Sequence[Fraction] = origin or [Fraction(0)] * x.numel()
    states = [_Node(symbol, turns) for symbol, turns in zip(ca.vertsplit(x), every, strict=True)]
    ring = Ring(numbers, {operation: _Operation(operation, table) for operation in OPERATIONS})
    entries = [table.whole(node) for node in evaluate(steps, [states], ring)]
    symbols = ca.vertcat(ca.SX(0, 1), *table.symbols.values())
    return Symbolised(ca.reshape(ca.vertcat(*entries), *expression.shape), symbols, tuple(table.symbols), tuple(sorted(table.read.items())))


@dataclass(frozen=True)
class Node:
    """An operation on expressions: one more node of the graph."""

    operation: int

    def __call__(self, a: ca.SX, b: ca.SX | None = None) -> ca.SX:
        return ca.SX.unary(self.operation, a) if b is None else ca.SX.binary(self.operation, a, b)


@dataclass(frozen=True, eq=False)
class _Node:
    """The value expression + turns pi; turns is a multiple of 1/12, factor the number that it is, if it is one."""

    expression: ca.SX
    turns: Fraction = Fraction(0)
    factor: Fraction | None = None


@dataclass(frozen=True, eq=False)
class _Table:
    """The symbols that stand for numbers, and what doubles stand for."""

    symbols: dict[Meaning, ca.SX] = field(default_factory=dict[Meaning, ca.SX])
    read: dict[float, Meaning] = field(default_factory=dict[float, Meaning])

    def symbol(self, number: Meaning) -> ca.SX:
        """Return what stands for the number in an expression."""
        if number in (0, 1, -1):
            return ca.SX(float(number))
        return self.symbols.setdefault(number, ca.SX.sym(f"constant {len(self.symbols)}"))

    def whole(self, node: _Node) -> ca.SX:
        """Return the node as an expression."""
        return node.expression + self.symbol(of_pi(node.turns)) if node.turns else node.expression


@dataclass(frozen=True)
class _Numbers:
    """What a constant of a graph becomes."""

    table: _Table
    meaning: Callable[[float], Meaning]

    def __call__(self, value: float) -> _Node:
        if not math.isfinite(value) or irrational_part(value):
            return _Node(ca.SX(value))
        number = self.table.read.setdefault(value, self.meaning(value))
        if isinstance(number, Fraction):
            return _Node(self.table.symbol(number), factor=number)
        turns = number.turns
        if turns is None:
            return _Node(self.table.symbol(number))
        twelfths = Fraction(math.floor(12 * turns), 12)
        return _Node(self.table.symbol(of_pi(turns - twelfths)), twelfths)


@dataclass(frozen=True)
class _Operation:
    """An operation on nodes."""

    code: int
    table: _Table

    def __call__(self, a: _Node, b: _Node | None = None) -> _Node:
        turned = b is not None and b.turns
        form = _OF_ANGLES.get(self.code) if a.turns or turned else None
        found = form(self.table, a, b or _Node(ca.SX(0))) if form else None
        if found:
            return found
        first = self.table.whole(a)
        if b is None:
            return _Node(ca.SX.unary(self.code, first))
        return _Node(ca.SX.binary(self.code, first, self.table.whole(b)))


def _product(a: _Node, b: _Node) -> _Node | None:
    """Return an angle times a number where that is an angle again."""
    angle, number = (a, b) if b.factor is not None else (b, a)
    if number.factor is None or (12 * number.factor * angle.turns).denominator != 1:
        return None
    return _Node(a.expression * b.expression, number.factor * angle.turns)


def _quotient(a: _Node, b: _Node) -> _Node | None:
    if not b.factor or (12 * a.turns / b.factor).denominator != 1:
        return None
    return _Node(a.expression / b.expression, a.turns / b.factor)


def _sine(table: _Table, angle: _Node) -> ca.SX:
    """sin(rest + a) = sin(rest) cos(a) + cos(rest) sin(a)."""
    rest, twelfths = angle.expression, int(12 * angle.turns)
    return ca.sin(rest) * table.symbol(cosine(twelfths)) + ca.cos(rest) * table.symbol(sine(twelfths))


def _cosine(table: _Table, angle: _Node) -> ca.SX:
    """cos(rest + a) = cos(rest) cos(a) - sin(rest) sin(a)."""
    rest, twelfths = angle.expression, int(12 * angle.turns)
    return ca.cos(rest) * table.symbol(cosine(twelfths)) + ca.sin(rest) * table.symbol(negative(sine(twelfths)))


def _tangent(table: _Table, angle: _Node) -> ca.SX:
    return ca.tan(angle.expression) if angle.turns.denominator == 1 else _sine(table, angle) / _cosine(table, angle)


_OF_ANGLES: Mapping[int, Callable[[_Table, _Node, _Node], _Node | None]] = {
    ca.OP_ADD: lambda _, a, b: _Node(a.expression + b.expression, a.turns + b.turns),
    ca.OP_SUB: lambda _, a, b: _Node(a.expression - b.expression, a.turns - b.turns),
    ca.OP_NEG: lambda _, a, __: _Node(-a.expression, -a.turns),
    ca.OP_TWICE: lambda _, a, __: _Node(ca.SX.unary(ca.OP_TWICE, a.expression), 2 * a.turns),
    ca.OP_MUL: lambda _, a, b: _product(a, b),
    ca.OP_DIV: lambda _, a, b: _quotient(a, b),
    ca.OP_SIN: lambda table, a, _: _Node(_sine(table, a)),
    ca.OP_COS: lambda table, a, _: _Node(_cosine(table, a)),
    ca.OP_TAN: lambda table, a, _: _Node(_tangent(table, a)),
}
"""What is done to angles that are known up to a multiple of pi / 12; None where the result is no such angle."""
