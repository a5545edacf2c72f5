"""Ranks that can be trusted: a CasADi graph evaluated instruction by instruction in ball arithmetic.

A rank is at least r because an r x r minor's ball excludes 0: that is a proof. It is at most r as far as the working
precision reaches: all that is left is balls around 0, thinner than 2^-(bits / 2) of the matrix's own scale.
Source: F. Johansson, "Arb: efficient arbitrary-precision midpoint-radius interval arithmetic", 2017.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Generic, NamedTuple, TypeVar

import casadi as ca
import flint
import numpy as np
from flint import arb, fmpq

from obsdesign.errors import InputError

PRECISIONS = (256, 512, 1024, 2048, 4096)
"""Working precisions [bits], tried in turn."""

Scalar = TypeVar("Scalar")
Rows = list[list[arb]]


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
class Ring(Generic[Scalar]):
    """Scalars that a graph can be evaluated over: what a constant stands for, what an operation (a code ca.OP_...) does."""

    constant: Callable[[float], Scalar]
    operation: Callable[[int, Sequence[Scalar]], Scalar]


def instructions(function: ca.Function) -> tuple[Instruction, ...]:
    """Return the steps of an SX function with one result."""
    steps = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        value = function.instruction_constant(k) if operation == ca.OP_CONST else 0.0
        steps.append(Instruction(operation, function.instruction_output(k)[-1], tuple(function.instruction_input(k)), value))
    return tuple(steps)


def evaluate(steps: Sequence[Instruction], arguments: Sequence[Sequence[Scalar]], ring: Ring[Scalar]) -> list[Scalar]:
    """Return the nonzeros of the result in column-major order; arguments: the nonzeros of each input."""
    work: dict[int, Scalar] = {}
    result: dict[int, Scalar] = {}
    for operation, target, sources, value in steps:
        if operation == ca.OP_INPUT:
            work[target] = arguments[sources[0]][sources[1]]
        elif operation == ca.OP_CONST:
            work[target] = ring.constant(value)
        elif operation == ca.OP_OUTPUT:
            result[target] = work[sources[0]]
        else:
            work[target] = ring.operation(operation, [work[source] for source in sources])
    return [result[k] for k in range(len(result))]


def _truth(yes: bool, no: bool) -> arb:
    return arb(1) if yes else arb(0) if no else arb.nan()


def _apart(a: arb, b: arb | int = 0) -> bool:
    return a < b or a > b


def _sign(a: arb) -> arb:
    return arb(1) if a > 0 else arb(-1) if a < 0 else arb.nan()


def _floor(a: arb) -> arb:
    return arb.nan() if a.contains_integer() else a.floor()


def _truncated(a: arb) -> arb:
    return arb(0) if abs(a) < 1 else _floor(a) if a > 0 else -_floor(-a)


_SAME_NAME = (
    *("sqrt", "exp", "expm1", "log", "log1p", "erf", "erfinv", "sin", "cos", "tan"),
    *("asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
)
# What has no smooth value (a comparison of equals, the kink of a norm, a pole) is nan, and nan spreads to the result.
_BALL_OPERATIONS: Mapping[int, Callable[..., arb]] = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_NEG: lambda a: -a,
    ca.OP_INV: lambda a: 1 / a,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_POW: lambda a, b: a**b,
    ca.OP_CONSTPOW: lambda a, b: a**b,
    **{getattr(ca, f"OP_{name.upper()}"): getattr(arb, name) for name in _SAME_NAME},
    ca.OP_ATAN2: lambda a, b: arb.atan2(a, b) if _apart(a) or _apart(b) else arb.nan(),
    ca.OP_HYPOT: lambda a, b: (a * a + b * b).sqrt(),
    ca.OP_FABS: lambda a: a * _sign(a),
    ca.OP_SIGN: _sign,
    ca.OP_COPYSIGN: lambda a, b: a * _sign(a) * _sign(b),
    ca.OP_FMIN: lambda a, b: a if a < b else b if b < a else arb.nan(),
    ca.OP_FMAX: lambda a, b: a if a > b else b if b > a else arb.nan(),
    ca.OP_FLOOR: _floor,
    ca.OP_CEIL: lambda a: -_floor(-a),
    ca.OP_FMOD: lambda a, b: a - b * _truncated(a / b),
    ca.OP_REMAINDER: lambda a, b: a - b * _floor(a / b + arb(0.5)),
    ca.OP_LT: lambda a, b: _truth(a < b, a > b),
    ca.OP_LE: lambda a, b: _truth(a < b, a > b),
    ca.OP_EQ: lambda a, b: _truth(False, _apart(a, b)),
    ca.OP_NE: lambda a, b: _truth(_apart(a, b), False),
    ca.OP_NOT: lambda a: _truth(a.is_zero(), _apart(a)),
    ca.OP_AND: lambda a, b: _truth(_apart(a) and _apart(b), a.is_zero() or b.is_zero()),
    ca.OP_OR: lambda a, b: _truth(_apart(a) or _apart(b), a.is_zero() and b.is_zero()),
    ca.OP_IF_ELSE_ZERO: lambda a, b: arb(0) if a.is_zero() else b if _apart(a) else arb.nan(),
    ca.OP_PRINTME: lambda a, _: a,
}
# The two irrational numbers that CasADi writes into derivatives, of erf and erfinv.
_IRRATIONAL = {2 / math.sqrt(math.pi): lambda: 2 / arb.pi().sqrt(), math.sqrt(math.pi) / 2: lambda: arb.pi().sqrt() / 2}


def _ball(value: float) -> arb:
    if value in _IRRATIONAL:
        return _IRRATIONAL[value]()
    if math.isfinite(value) and (math.frexp(value)[0] * 2**45) % 1:
        raise NotExactError(f"the constant {value!r} of an expression may have been rounded: it has more than 45 bits, see symbolise")
    return arb(value)


def _require_supported(operation: int) -> None:
    if operation not in _BALL_OPERATIONS:
        name = next((name for name in dir(ca) if name.startswith("OP_") and getattr(ca, name) == operation), str(operation))
        raise NotExactError(f"the operation {name} cannot be evaluated in ball arithmetic: write it with others")


def _ball_operation(operation: int, operands: Sequence[arb]) -> arb:
    _require_supported(operation)
    return _BALL_OPERATIONS[operation](*operands)


BALLS = Ring(_ball, _ball_operation)
"""Midpoint-radius numbers at the working precision `flint.ctx.prec`; constants that may have been rounded are refused."""


@dataclass(frozen=True, eq=False)
class Symbolised:
    """An expression whose constants but 0 and +-1 are symbols (k, 1) with exact values: differentiating rounds none."""

    expression: ca.SX
    constants: ca.SX
    values: tuple[Fraction, ...]


def _symbolic_operation(operation: int, operands: Sequence[ca.SX]) -> ca.SX:
    _require_supported(operation)
    return ca.SX.unary(operation, operands[0]) if len(operands) == 1 else ca.SX.binary(operation, operands[0], operands[1])


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
    kept = {0.0, 1.0, *_IRRATIONAL}
    numbers = sorted({step.value for step in steps if math.isfinite(step.value) and abs(step.value) not in kept})
    symbols = ca.SX.sym("constant", len(numbers))
    stand_in = dict(zip(numbers, ca.vertsplit(symbols), strict=True))
    ring = Ring(lambda number: stand_in.get(number, ca.SX(number)), _symbolic_operation)
    entries = evaluate(steps, [ca.vertsplit(x)], ring)
    return Symbolised(ca.reshape(ca.vertcat(*entries), *expression.shape), symbols, tuple(as_rational(number) for number in numbers))


@dataclass(frozen=True, eq=False)
class Rank:
    """Rank of a matrix (m, n) at a point: at least `rank` by proof; where not `decided`, perhaps more.

    bits: precision used; rows, columns: of the pivots, in order; null_space (n, n - rank): orthonormal basis of what the
    pivots' rows annihilate, a row of it exactly 0 where the column's unit covector is in the row space;
    smallest_pivot, largest_remainder: what was told from 0 and what was not, relative to rows and columns scaled to 1.
    """

    rank: int
    decided: bool
    bits: int
    smallest_pivot: float
    largest_remainder: float
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    null_space: np.ndarray


def rank_at(matrix: ca.Function, arguments: Sequence[Sequence[Fraction]], stages: Sequence[int] | None = None) -> Rank:
    """Return the rank of matrix(arguments) (m, n), doubling the precision until it is decided or the limit reached.

    stages: a number per row; pivots come from rows of a lower stage as long as these have any.
    Raises NoValueError where a row has no finite value at any precision, NotExactError.
    """
    steps, shape = instructions(matrix), matrix.sparsity_out(0)
    rank, failed = None, []
    for bits in PRECISIONS:
        with flint.ctx.workprec(bits):
            rows = _rows(shape, steps, arguments)
            failed = [i for i, row in enumerate(rows) if not all(entry.is_finite() for entry in row)]
            rank = None if failed else _eliminate(rows, shape.size2(), stages or [0] * len(rows))
        if rank and rank.decided:
            break
    if rank is None:
        raise NoValueError(failed[0], f"row {failed[0]} of the matrix")
    return rank


def _rows(shape: ca.Sparsity, steps: Sequence[Instruction], arguments: Sequence[Sequence[Fraction]]) -> Rows:
    """Return the matrix at the working precision."""
    balls = [[arb(fmpq(value.numerator, value.denominator)) for value in argument] for argument in arguments]
    rows = [[arb(0)] * shape.size2() for _ in range(shape.size1())]
    for entry, i, j in zip(evaluate(steps, balls, BALLS), shape.row(), shape.get_col(), strict=True):
        rows[i][j] = entry
    return rows


def _eliminate(rows: Rows, n: int, stages: Sequence[int]) -> Rank:
    """Gauss-Jordan elimination with full pivoting within each stage, on rows and columns scaled by powers of 2."""
    rows = [_scaled(row, [_exponent(row)] * n) for row in rows]
    widths = [_exponent([row[j] for row in rows]) for j in range(n)]
    rows = [_scaled(row, widths) for row in rows]
    pivots: dict[int, int] = {}
    smallest = math.inf
    while pivot := _pivot(rows, pivots, n, stages):
        row, column = pivot
        smallest = min(smallest, float(rows[row][column].abs_lower()))
        rows = _cleared(rows, row, column)
        pivots[column] = row
    free = [j for j in range(n) if j not in pivots]
    left = [rows[i][j].abs_upper() for i in range(len(rows)) if i not in pivots.values() for j in free]
    zeros = [rows[i][j].abs_upper() for i in pivots.values() for j in free if 0 in rows[i][j]]
    thin = arb(2) ** (-flint.ctx.prec // 2)
    return Rank(
        rank=len(pivots),
        decided=all(size <= thin for size in left + zeros),
        bits=flint.ctx.prec,
        smallest_pivot=smallest,
        largest_remainder=max(map(float, left), default=0.0),
        rows=tuple(pivots.values()),
        columns=tuple(pivots),
        null_space=_orthonormal([_null_vector(rows, pivots, j, widths) for j in free], n),
    )


def _exponent(entries: Sequence[arb]) -> int:
    """Return the least e with |entry| <= 2^e, as far as the entries exclude 0: balls around 0 are not blown up."""
    mantissa, exponent = max((entry.abs_lower() for entry in entries), default=arb(0)).man_exp()
    return int(exponent) + int(mantissa).bit_length()


def _scaled(row: Sequence[arb], exponents: Sequence[int]) -> list[arb]:
    """Return the row with entry j divided by 2^exponents[j], exactly."""
    return [entry * arb((1, -exponent)) for entry, exponent in zip(row, exponents, strict=True)]


def _pivot(rows: Rows, pivots: Mapping[int, int], n: int, stages: Sequence[int]) -> tuple[int, int] | None:
    """Return row and column of the entry farthest from 0 in the lowest stage with an entry that excludes 0."""
    rows_left = [i for i in range(len(rows)) if i not in pivots.values()]
    for stage in sorted({stages[i] for i in rows_left}):
        sizes = [(rows[i][j].abs_lower(), i, j) for i in rows_left if stages[i] == stage for j in range(n) if j not in pivots]
        size, row, column = max(sizes, default=(arb(0), 0, 0))
        if size > 0:
            return row, column
    return None


def _cleared(rows: Rows, row: int, column: int) -> Rows:
    """Return the rows with the pivot made 1 and the rest of its column exactly 0."""
    unit = [arb(1) if j == column else entry / rows[row][column] for j, entry in enumerate(rows[row])]
    return [
        unit if i == row else [arb(0) if j == column else entry - other[column] * unit[j] for j, entry in enumerate(other)]
        for i, other in enumerate(rows)
    ]


def _null_vector(rows: Rows, pivots: Mapping[int, int], free: int, widths: Sequence[int]) -> list[float]:
    """Return the vector (n,) that the pivots' rows annihilate with its free entry not 0, in units of the unscaled columns."""
    vector = [-rows[pivots[j]][free] if j in pivots else arb(int(j == free)) for j in range(len(widths))]
    balanced = _scaled(vector, [width - min(widths) for width in widths])
    return [0.0 if 0 in entry else float(entry) for entry in balanced]


def _orthonormal(vectors: Sequence[Sequence[float]], n: int) -> np.ndarray:
    """Return an orthonormal basis (n, d) of the span of d independent vectors (n,); rows of zeros stay exactly 0."""
    if not vectors:
        return np.zeros((n, 0))
    columns = np.array(vectors).T
    basis = np.linalg.qr(columns / np.abs(columns).max(axis=0))[0]
    return np.where(np.any(columns != 0, axis=1, keepdims=True), basis, 0.0)
