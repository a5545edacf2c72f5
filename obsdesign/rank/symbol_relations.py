"""Relations among the symbols that stand for functions: exp(a + b) = exp(a) exp(b), exp(log a) = a, the sine of an angle from atan2.

By a theorem of J. Ax (On Schanuel's conjectures, 1971) functions exp(a_i) of a field of functions satisfy no algebraic relation but
those that follow from a_i that are sums of each other: so these are looked for. One that is missed can only raise a rank.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import casadi as ca

from obsdesign.rank.balls import OPERATIONS
from obsdesign.rank.exact_constants import NodeOperation
from obsdesign.rank.exact_numbers import Number, as_residue
from obsdesign.rank.graph import Instruction, Ring, evaluate, instructions
from obsdesign.rank.residues import modular_arithmetic
from obsdesign.rank.symbols import PRIME, TWELFTH, Decomposition, Symbols, as_small_fraction, direction_symbol, odd_symbol

_EXP = {getattr(ca, f"OP_{name}") for name in ("EXP", "EXPM1", "SINH", "COSH", "TANH")}
_CIRCLE = {ca.OP_SIN, ca.OP_COS, ca.OP_TAN}
# _MULTIPLES: of one argument that are looked for in another; pairs of them are tried, so that work grows as the square
_MULTIPLES = (1, -1, 2, -2, 3, -3)
_MAX_ARGUMENTS = 24
"""Among more arguments than this, sums are not looked for."""
_PASSES = 4  # at most, each with the sums of the one before, for sums inside sums; one that finds nothing new is the last
_MAX_SHORT = 2**12
"""Numerators and denominators of the constants in a sum: larger ones could come about by chance."""


@dataclass(frozen=True, eq=False)
class FunctionArguments:
    """Arguments of the functions of a graph: (x, constants) -> column, and for every entry what it is the argument of.

    kinds: "exp", "circle" (sine and cosine), "log", "angle" (two entries in turn: rise and run), "tangent", "sine", "other".
    steepness: (x, constants) -> column of the arguments of functions that grow or fade like exp.
    """

    kinds: tuple[str, ...]
    arguments: ca.SX
    function: ca.Function
    steepness: ca.Function

    @property
    def is_empty(self) -> bool:
        """Whether everything is rational."""
        return not self.kinds


def function_arguments(steps: Sequence[Instruction], symbols: tuple[ca.SX, ca.SX]) -> FunctionArguments:
    """Return what a graph of (x, constants) makes use of."""
    entries: list[tuple[str, ca.SX]] = []
    steep_arguments: list[ca.SX] = []

    def recording_operation(operation: int):  # noqa: ANN202  # an operation of a ring
        """Return the operation, which also records what its arguments are."""
        node = NodeOperation(operation)

        def apply(*arguments: ca.SX) -> ca.SX:
            """Record the arguments and return the result."""
            entries.extend(_entries(operation, arguments))
            steep_arguments.extend(_steep(operation, arguments))
            return node(*arguments)

        return apply

    ring = Ring(ca.SX, {operation: recording_operation(operation) for operation in OPERATIONS})
    evaluate(steps, [ca.vertsplit(group) if group.numel() else [] for group in symbols], ring)
    column = ca.vertcat(ca.SX(0, 1), *(ca.densify(argument) for _, argument in entries))
    steepness = ca.vertcat(ca.SX(0, 1), *(ca.densify(argument) for argument in steep_arguments))
    functions = (ca.Function("arguments", list(symbols), [expression]) for expression in (column, steepness))
    return FunctionArguments(tuple(kind for kind, _ in entries), column, *functions)


_KINDS = {
    **dict.fromkeys(_EXP, "exp"),
    **dict.fromkeys(_CIRCLE, "circle"),
    ca.OP_LOG: "log",
    ca.OP_ATAN: "tangent",
    ca.OP_ASIN: "sine",
    ca.OP_ACOS: "sine",
}
_OTHERS = {getattr(ca, f"OP_{name}") for name in ("SQRT", "POW", "CONSTPOW", "ERFINV", "ASINH", "ACOSH", "ATANH", "HYPOT")}


def _entries(operation: int, arguments: Sequence[ca.SX]) -> list[tuple[str, ca.SX]]:
    a = arguments[0]
    if operation == ca.OP_ERF:
        return [("exp", -a * a)]
    if operation == ca.OP_LOG1P:
        return [("log", 1 + a)]
    if operation == ca.OP_ATAN2:
        return [("angle", a), ("angle", arguments[1])]
    if operation in _OTHERS:
        return [("other", a)]
    return [(_KINDS[operation], a)] if operation in _KINDS else []


def _steep(operation: int, arguments: Sequence[ca.SX]) -> list[ca.SX]:
    a = arguments[0]
    if operation in _EXP:
        return [a]
    if operation in {ca.OP_ERF, ca.OP_ERFINV}:
        return [a * a]
    if operation in {ca.OP_POW, ca.OP_CONSTPOW}:
        return [arguments[1] * ca.log(ca.fabs(a))]
    return []


def symbols_at(
    function_arguments: FunctionArguments, state: Sequence[Number], constants: Sequence[Number], *, has_free_roots: bool
) -> Symbols:
    """Return the symbols at a state modulo the prime, with the relations that are found there.

    Arguments may be values of functions themselves, which change with the relations: so it is done again until nothing changes.
    """
    symbols = Symbols(has_free_roots=has_free_roots)
    if function_arguments.is_empty:
        return symbols
    steps = instructions(function_arguments.function)
    inputs = [[as_residue(value) for value in group] for group in (state, constants)]
    for _ in range(_PASSES):
        values = [int(value) for value in evaluate(steps, inputs, modular_arithmetic(symbols))]
        relations = _relations(list(zip(function_arguments.kinds, values, strict=True)), has_free_roots)
        if (relations.sums, relations.logarithms, relations.angles) == (symbols.sums, symbols.logarithms, symbols.angles):
            break
        symbols = relations
    return symbols


def _relations(values: Sequence[tuple[str, int]], has_free_roots: bool) -> Symbols:
    by_kind = {
        kind: list(dict.fromkeys(value for name, value in values if name == kind)) for kind in ("exp", "circle", "log", "tangent", "sine")
    }
    directions = [value for name, value in values if name == "angle"]
    logarithms = {Symbols.log(a): a for a in by_kind["log"] if a}
    angles = dict(_angles(directions, by_kind["tangent"], by_kind["sine"]))
    sums = _sums(by_kind["exp"], list(logarithms)) | _sums(by_kind["circle"], list(angles), is_angle=True)
    return Symbols(sums, logarithms, angles, has_free_roots)


def _angles(directions: Sequence[int], tangents: Sequence[int], sines: Sequence[int]) -> Iterator[tuple[int, tuple[int, int]]]:
    """Yield angles with their cosine and sine, where the roots in these exist."""
    pairs = [(direction_symbol(a, b), b, a) for a, b in zip(directions[::2], directions[1::2], strict=True)]
    pairs += [(odd_symbol("atan", a), 1, a) for a in tangents]
    for angle, run, rise in pairs:
        root = _root(rise * rise + run * run)
        if root:
            yield angle, (run * pow(root, -1, PRIME) % PRIME, rise * pow(root, -1, PRIME) % PRIME)
    for a in sines:
        root = _root(1 - a * a)
        if root:
            yield odd_symbol("asin", a), (root, a)


def _root(a: int) -> int:
    try:
        return Symbols().sqrt(a % PRIME)
    except ZeroDivisionError:
        return 0


def _sums(arguments: Sequence[int], fixed_basis: Sequence[int], *, is_angle: bool = False) -> dict[int, Decomposition]:
    """Return arguments that are sums of whole multiples of one or two others, and a short constant."""
    if len(arguments) + len(fixed_basis) > _MAX_ARGUMENTS:
        return {}
    basis = list(fixed_basis)
    sums: dict[int, Decomposition] = {}
    for a in dict.fromkeys(min(a, PRIME - a) for a in arguments if a):
        parts = _decompose(a, basis, is_angle)
        if parts is None:
            sums |= {
                key: value
                for b in basis
                for multiple in _MULTIPLES[2:]
                if b == multiple * a % PRIME
                for key, value in _with_negative(b, ((a, multiple),))
            }
            basis = [*(b for b in basis if b not in sums), a]
        elif parts != ((a, 1),):
            sums |= dict(_with_negative(a, parts))
    return sums


def _with_negative(a: int, parts: Decomposition) -> tuple[tuple[int, Decomposition], tuple[int, Decomposition]]:
    """Return the sums that a and -a are."""
    return (a, parts), (PRIME - a, tuple((part, -multiple) for part, multiple in parts))


def _decompose(a: int, basis: Sequence[int], is_angle: bool) -> Decomposition | None:
    """Return what a is the sum of; None where it is not seen to be one."""
    for b in basis:
        for multiple in _MULTIPLES:
            remainder = (a - multiple * b) % PRIME
            if remainder == 0:
                return ((b, multiple),)
            if _is_short(remainder, is_angle) and not _is_short(b, is_angle):
                return ((b, multiple), (remainder, 1))
    for b, c in combinations(basis, 2):
        for multiple in _MULTIPLES:
            for second_multiple in _MULTIPLES:
                if (a - multiple * b - second_multiple * c) % PRIME == 0:
                    return ((b, multiple), (c, second_multiple))
    return None


def _is_short(a: int, is_angle: bool) -> bool:
    """Return whether a is the residue of a short rational, or (turns) of a multiple of pi / 12."""
    if is_angle and (a * pow(TWELFTH, -1, PRIME) + 48) % PRIME <= 96:
        return True
    fraction = as_small_fraction(a)
    return fraction is not None and abs(fraction[0]) < _MAX_SHORT and fraction[1] < _MAX_SHORT
