"""The numbers of an expression as symbols with exact values: CasADi would round them while it differentiates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import casadi as ca

from obsdesign.rank.balls import IRRATIONAL, OPERATIONS
from obsdesign.rank.graph import Ring, evaluate, instructions


@dataclass(frozen=True, eq=False)
class Symbolised:
    """An expression whose constants but 0 and +-1 are symbols (k, 1) with exact values: differentiating rounds none."""

    expression: ca.SX
    constants: ca.SX
    values: tuple[Fraction, ...]


def as_rational(value: float) -> Fraction:
    """Return the number that was meant: p/q with q <= 10^6 where that rounds to value, else the decimal literal."""
    near = Fraction(value).limit_denominator(10**6)
    return near if float(near) == value else Fraction(repr(float(value)))


def symbolise(x: ca.SX, expression: ca.SX) -> Symbolised:
    """Return the dense expression of x (n, 1) with a symbol for every constant.

    CasADi works on constants in double precision while it differentiates: x / 3 / 49 would get the gradient 0.00680...,
    and exact arithmetic would then prove a wrong rank.
    """
    steps = instructions(ca.Function("expression", [x], [ca.densify(expression)]))
    kept = {0.0, 1.0, *IRRATIONAL}
    numbers = sorted({step.value for step in steps if math.isfinite(step.value) and abs(step.value) not in kept})
    symbols = ca.SX.sym("constant", len(numbers))
    stand_in = dict(zip(numbers, ca.vertsplit(symbols), strict=True))
    ring = Ring(lambda number: stand_in.get(number, ca.SX(number)), {operation: _Node(operation) for operation in OPERATIONS})
    entries = evaluate(steps, [ca.vertsplit(x)], ring)
    return Symbolised(ca.reshape(ca.vertcat(*entries), *expression.shape), symbols, tuple(as_rational(number) for number in numbers))


@dataclass(frozen=True)
class _Node:
    """An operation on expressions: one more node of the graph."""

    operation: int

    def __call__(self, a: ca.SX, b: ca.SX | None = None) -> ca.SX:
        return ca.SX.unary(self.operation, a) if b is None else ca.SX.binary(self.operation, a, b)
