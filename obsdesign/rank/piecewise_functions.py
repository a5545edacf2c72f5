"""Functions with pieces, such as abs and if_else, as the smooth function that they are near a point."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import flint
from flint import arb

from obsdesign.rank.balls import BALLS, OPERATIONS, PRECISIONS, lead
from obsdesign.rank.exact_constants import Node
from obsdesign.rank.exact_numbers import Number, as_ball
from obsdesign.rank.graph import NoValueError, Ring, evaluate, instructions


class _Both(NamedTuple):
    """An expression and its value."""

    value: arb
    node: ca.SX


def smooth_near(function: ca.Function, symbols: Sequence[ca.SX], point: Sequence[Sequence[Number]]) -> ca.SX:
    """Return the result of a function (dense, one column) as a smooth expression of the symbols that is the same near the point.

    symbols, point: a column and its numbers for every argument. Raises NoValueError where the point lies on the border of pieces.
    """
    steps = instructions(function)
    values: list[_Both] = []
    for bits in PRECISIONS:
        with flint.ctx.workprec(bits):
            pairs = [
                [_Both(as_ball(number), symbol) for number, symbol in zip(numbers, ca.vertsplit(column), strict=True)]
                for numbers, column in zip(point, symbols, strict=True)
            ]
            values = evaluate(steps, pairs, Ring(lambda number: _Both(BALLS.constant(number), ca.SX(number)), _operations()))
        if all(each.value.is_finite() for each in values):
            return ca.vertcat(*(each.node for each in values))
    row = next(i for i, each in enumerate(values) if not each.value.is_finite())
    raise NoValueError(row, f"row {row}")


def _operations() -> Mapping[int, Callable[..., _Both]]:
    return {operation: _Smooth(operation) for operation in OPERATIONS}


@dataclass(frozen=True)
class _Smooth:
    """An operation on expressions, replaced by what it is where its arguments have their values."""

    operation: int

    def __call__(self, *arguments: _Both) -> _Both:
        value = lead(OPERATIONS[self.operation](*(argument.value for argument in arguments)))
        return _Both(value, self._node(value, arguments) if value.is_finite() else ca.SX.nan())

    def _node(self, value: arb, arguments: Sequence[_Both]) -> ca.SX:
        if self.operation in _CONSTANT:
            return ca.SX(float(value.mid()))
        if self.operation in _FORMS:
            return _FORMS[self.operation](*arguments)
        return Node(self.operation)(*(argument.node for argument in arguments))


def _sign(a: _Both) -> int:
    return 1 if a.value > 0 else -1


def _fmod(a: _Both, b: _Both) -> ca.SX:
    quotient = a.value / b.value
    whole = quotient.floor() if quotient > 0 else -((-quotient).floor())
    return a.node - b.node * float(whole.mid())


def _remainder(a: _Both, b: _Both) -> ca.SX:
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
