"""Functions with pieces, such as abs and if_else, as the smooth function that they are near a point."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import flint
from flint import arb

from obsdesign.rank.balls import BALLS, OPERATIONS, PRECISIONS, constant_term
from obsdesign.rank.exact_constants import NodeOperation
from obsdesign.rank.exact_numbers import Number, as_ball
from obsdesign.rank.graph import NoValueError, Ring, evaluate, instructions


class _ValuedNode(NamedTuple):
    """An expression and its value."""

    value: arb
    node: ca.SX


def smooth_near(function: ca.Function, symbols: Sequence[ca.SX], point: Sequence[Sequence[Number]]) -> ca.SX:
    """Return the result of a function (dense, one column) as a smooth expression of the symbols that is the same near the point.

    symbols, point: a column and its numbers for every argument. Raises NoValueError where the point lies on the border of pieces.
    """
    steps = instructions(function)
    values: list[_ValuedNode] = []
    for bits in PRECISIONS:
        with flint.ctx.workprec(bits):
            pairs = [
                [_ValuedNode(as_ball(number), symbol) for number, symbol in zip(numbers, ca.vertsplit(column), strict=True)]
                for numbers, column in zip(point, symbols, strict=True)
            ]
            values = evaluate(steps, pairs, Ring(lambda number: _ValuedNode(BALLS.constant(number), ca.SX(number)), _operations()))
        if all(entry.value.is_finite() for entry in values):
            return ca.vertcat(*(entry.node for entry in values))
    row = next(i for i, entry in enumerate(values) if not entry.value.is_finite())
    raise NoValueError(row, f"row {row}")


def _operations() -> Mapping[int, Callable[..., _ValuedNode]]:
    return {operation: _SmoothOperation(operation) for operation in OPERATIONS}


@dataclass(frozen=True)
class _SmoothOperation:
    """An operation on expressions, replaced by what it is where its arguments have their values."""

    operation: int

    def __call__(self, *arguments: _ValuedNode) -> _ValuedNode:
        value = constant_term(OPERATIONS[self.operation](*(argument.value for argument in arguments)))
        return _ValuedNode(value, self._node(value, arguments) if value.is_finite() else ca.SX.nan())

    def _node(self, value: arb, arguments: Sequence[_ValuedNode]) -> ca.SX:
        if self.operation in _CONSTANT:
            return ca.SX(float(value.mid()))
        if self.operation in _FORMS:
            return _FORMS[self.operation](*arguments)
        return NodeOperation(self.operation)(*(argument.node for argument in arguments))


def _sign(a: _ValuedNode) -> int:
    return 1 if a.value > 0 else -1


def _fmod(a: _ValuedNode, b: _ValuedNode) -> ca.SX:
    quotient = a.value / b.value
    truncated = quotient.floor() if quotient > 0 else -((-quotient).floor())
    return a.node - b.node * float(truncated.mid())


def _remainder(a: _ValuedNode, b: _ValuedNode) -> ca.SX:
    return a.node - b.node * float((a.value / b.value + arb(0.5)).floor().mid())


_CONSTANT = {getattr(ca, f"OP_{name}") for name in ("SIGN", "FLOOR", "CEIL", "LT", "LE", "EQ", "NE", "NOT", "AND", "OR")}
_FORMS: Mapping[int, Callable[..., ca.SX]] = {
    ca.OP_FABS: lambda a: a.node * _sign(a),
    ca.OP_COPYSIGN: lambda a, b: a.node * (_sign(a) * _sign(b)),
    ca.OP_FMIN: lambda a, b: a.node if a.value < b.value else b.node,
    ca.OP_FMAX: lambda a, b: b.node if a.value < b.value else a.node,
    ca.OP_FMOD: _fmod,
    ca.OP_REMAINDER: _remainder,
    ca.OP_IF_ELSE_ZERO: lambda a, b: ca.SX(0) if a.value.is_zero() else b.node,
}
