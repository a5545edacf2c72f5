"""A CasADi graph as a list of instructions, evaluated over any ring that says what each operation does."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import casadi as ca

from obsdesign.common_subexpressions import without_repeats
from obsdesign.errors import InputError


class NotExactError(InputError):
    """An operation or a constant of an expression has no exact counterpart."""


class NoValueError(InputError):
    """Row `row` of a matrix has no finite smooth value at the point: a pole, a kink, outside the domain."""

    def __init__(self, row: int, what: str) -> None:
        super().__init__(f"{what} has no finite smooth value")
        self.row = row
        self.what = what

    def __reduce__(self) -> tuple[type, tuple[int, str]]:
        return type(self), (self.row, self.what)


class Instruction(NamedTuple):
    """One step of a graph: work[target] = operation(work[sources]); value is the number of a constant."""

    operation: int
    target: int
    sources: tuple[int, ...]
    value: float


@dataclass(frozen=True)
class Ring:
    """Scalars that a graph can be evaluated over: what a constant stands for, what an operation (a code ca.OP_...) does."""

    constant: Callable[[float], Any]
    operations: Mapping[int, Callable[..., Any]]


@dataclass(frozen=True)
class Arithmetic(Ring):
    """A ring whose elements also come as power series in t, built from coefficients, and in matrices (m, n, entries row by row).

    number: what a rational stands for; coefficients: those of a series or of a constant.
    """

    number: Callable[[Any], Any]
    series: Callable[[Sequence[Any]], Any]
    coefficients: Callable[[Any], Sequence[Any]]
    matrix: Callable[[int, int, list[Any]], Any]


def instructions(function: ca.Function) -> tuple[Instruction, ...]:
    """Return the steps of an SX function with one result."""
    steps = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        value = function.instruction_constant(k) if operation == ca.OP_CONST else 0.0
        steps.append(Instruction(operation, function.instruction_output(k)[-1], tuple(function.instruction_input(k)), value))
    return tuple(steps)


Graph = tuple[ca.Sparsity, tuple[Instruction, ...]]
"""The steps of an expression, and which of its entries they are for."""


def graphs_of(symbols: Sequence[ca.SX], expressions: Mapping[str, ca.SX]) -> dict[str, Graph]:
    """Return the graph of each expression of the symbols."""
    functions = {name: ca.Function(name, list(symbols), without_repeats([value])) for name, value in expressions.items()}
    return {name: (function.sparsity_out(0), instructions(function)) for name, function in functions.items()}


def evaluate(steps: Iterable[Instruction], arguments: Sequence[Sequence[Any]], ring: Ring) -> list[Any]:
    """Return the nonzeros of the result in column-major order; arguments: the nonzeros of each input.

    Raises NotExactError, and ZeroDivisionError from a ring that has no value for a quotient by zero.
    """
    work: dict[int, Any] = {}
    result: dict[int, Any] = {}
    for operation, target, sources, value in steps:
        if operation == ca.OP_INPUT:
            work[target] = arguments[sources[0]][sources[1]]
        elif operation == ca.OP_CONST:
            work[target] = ring.constant(value)
        elif operation == ca.OP_OUTPUT:
            result[target] = work[sources[0]]
        elif operation in ring.operations:
            work[target] = ring.operations[operation](*[work[source] for source in sources])
        else:
            raise NotExactError(f"the operation {_name(operation)} cannot be evaluated in exact arithmetic: write it with others")
    return [result[k] for k in range(len(result))]


def supports_of(steps: Sequence[Instruction]) -> list[frozenset[int]]:
    """Return for every step the entries of the first argument that its value may depend on."""
    work: dict[int, frozenset[int]] = {}
    supports: list[frozenset[int]] = []
    for operation, target, sources, _ in steps:
        if operation == ca.OP_INPUT:
            support = frozenset({sources[1]} if sources[0] == 0 else ())
        elif operation == ca.OP_OUTPUT:
            supports.append(work[sources[0]])
            continue
        else:
            support = frozenset().union(*(work[source] for source in sources)) if operation != ca.OP_CONST else frozenset()
        work[target] = support
        supports.append(support)
    return supports


_STRUCTURE = {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
_RATIONAL = {*_STRUCTURE, *(getattr(ca, f"OP_{name}") for name in ("ADD", "SUB", "MUL", "DIV", "NEG", "INV", "SQ", "TWICE"))}


_PIECES = "FABS SIGN COPYSIGN FMIN FMAX FLOOR CEIL FMOD REMAINDER LT LE EQ NE NOT AND OR IF_ELSE_ZERO"
_PIECEWISE = {getattr(ca, f"OP_{name}") for name in _PIECES.split()}


def has_pieces(steps: Sequence[Instruction]) -> bool:
    """Return whether the result may be another function elsewhere."""
    return any(step.operation in _PIECEWISE for step in steps)


def is_rational(steps: Sequence[Instruction]) -> bool:
    """Return whether the result is a quotient of polynomials in the arguments, with constants that are exact."""
    return all(step.operation in _RATIONAL and is_short(step.value) for step in steps)


def is_short(value: float) -> bool:
    """Return whether a double has at most 45 bits: longer ones may be the rounded result of an operation."""
    return math.isfinite(value) and (math.frexp(value)[0] * 2**45) % 1 == 0


def require_short(value: float) -> None:
    """Raise NotExactError unless the constant has at most 45 bits."""
    if not is_short(value):
        raise NotExactError(f"the constant {value!r} of an expression may have been rounded: it has more than 45 bits, see symbolise")


@cache
def _name(operation: int) -> str:
    return next((name for name in dir(ca) if name.startswith("OP_") and getattr(ca, name) == operation), str(operation))
