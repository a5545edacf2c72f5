"""A model as the analysis reads it: bare expressions whose constants are symbols with exact values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import accumulate

import casadi as ca
import flint

from obsdesign.analysis.evaluation_point import Place
from obsdesign.checks import require_known
from obsdesign.dynamics.model import Model
from obsdesign.rank.balls import PRECISIONS
from obsdesign.rank.decimal_reading import read
from obsdesign.rank.elimination import values_at
from obsdesign.rank.exact_constants import symbolise
from obsdesign.rank.exact_numbers import Meaning, Number
from obsdesign.rank.graph import Instruction, has_pieces, instructions, is_rational
from obsdesign.rank.piecewise_functions import smooth_near
from obsdesign.rank.symbol_relations import Used, used
from obsdesign.rank.taylor import Flow

Exact = tuple[Meaning, ...]


@dataclass(frozen=True, eq=False)
class Piece:
    """One piece of functions of n states: (x, constants) -> their values on this piece, and on the piece where x lies."""

    n: int
    here: ca.Function
    anywhere: ca.Function
    values: Exact

    def holds(self, state: Sequence[Number]) -> bool:
        """Return whether the state (..., n), perhaps behind added ones, lies in this piece."""
        arguments = (state[len(state) - self.n :], self.values)
        with flint.ctx.workprec(PRECISIONS[1]):
            here, anywhere = (values_at(function, arguments) for function in (self.here, self.anywhere))
        return all(a.overlaps(b) for rows in zip(here, anywhere, strict=True) for a, b in zip(*rows, strict=True))


@dataclass(frozen=True, eq=False)
class Equations:
    """xdot = drift + sum_i known_i u_i + sum_j unknown_j w_j, y = outputs (q, 1); fields are SX (n, 1).

    constants (c, 1): symbols for the numbers in all of these, with their values; extra: how many states come first that
    were added, and are not asked for; origin (n,): x is the state that was asked about less origin pi; read: doubles of the
    model, each with what it stands for; piece: which one these are, where functions have pieces.
    """

    x: ca.SX
    names: tuple[str, ...]
    constants: ca.SX
    values: Exact
    drift: ca.SX
    known: tuple[ca.SX, ...]
    unknown: tuple[ca.SX, ...]
    outputs: ca.SX
    output_names: tuple[str, ...]
    extra: int = 0
    origin: tuple[Fraction, ...] = ()
    read: tuple[tuple[float, Meaning], ...] = ()
    piece: Piece | None = None

    @property
    def n(self) -> int:
        """Number of states."""
        return self.x.numel()

    @property
    def asked(self) -> int:
        """Number of states that are asked for."""
        return self.n - self.extra

    @cached_property
    def everything(self) -> ca.Function:
        """(x, constants) -> outputs, drift, known and unknown fields in one column."""
        return self.function(ca.densify(ca.vertcat(self.outputs, self.drift, *self.known, *self.unknown)))

    @cached_property
    def _steps(self) -> tuple[Instruction, ...]:
        return instructions(self.everything)

    @cached_property
    def is_rational(self) -> bool:
        """Whether all expressions are quotients of polynomials with rational coefficients."""
        return is_rational(self._steps)

    @property
    def has_pieces(self) -> bool:
        """Whether some expression is another function elsewhere."""
        return has_pieces(self._steps)

    @cached_property
    def symbols_used(self) -> Used:
        """The functions in these expressions that are symbols modulo a prime."""
        return used(self._steps, (self.x, self.constants))

    def smooth_near(self, place: Sequence[Number]) -> Equations:
        """Return the equations without pieces that are these near a state (n,). Raises NoValueError on the border of pieces."""
        column = smooth_near(self.everything, (self.x, self.constants), (place, self.values))
        lengths = [self.outputs.numel(), *[self.n] * (1 + len(self.known) + len(self.unknown))]
        outputs, drift, *fields = ca.vertsplit(column, [0, *accumulate(lengths)])
        known, unknown = tuple(fields[: len(self.known)]), tuple(fields[len(self.known) :])
        smooth = replace(self, outputs=outputs, drift=drift, known=known, unknown=unknown)
        return replace(smooth, piece=Piece(self.n, smooth.everything, self.everything, self.values))

    @cached_property
    def flow(self) -> Flow:
        """The equations with symbols for the inputs."""
        u, w = ca.SX.sym("u", len(self.known)), ca.SX.sym("w", len(self.unknown))
        pairs = [*zip(self.known, ca.vertsplit(u), strict=True), *zip(self.unknown, ca.vertsplit(w), strict=True)]
        rate = self.drift + sum((field * symbol for field, symbol in pairs), ca.SX.zeros(self.n))
        return Flow(self.x, u, w, self.constants, rate, self.outputs)

    @property
    def fields(self) -> tuple[ca.SX, ...]:
        """Drift and known fields, those that vanish left out."""
        return tuple(field for field in (self.drift, *self.known) if not field.is_zero())

    def state_at(self, place: Place) -> Place:
        """Return the state that was asked about, of which the place is what these equations make."""
        return place.less([-turns for turns in self.origin]) if self.origin else place

    def where(self, place: Place) -> str:
        """Say where the place is."""
        return self.state_at(place).in_words(self.names)

    def function(self, expression: ca.SX) -> ca.Function:
        """Return (x, constants) -> expression."""
        return ca.Function("expression", [self.x, self.constants], [expression])

    def with_all_known(self) -> Equations:
        """Return the equations as they are for somebody who knows the unknown inputs."""
        return replace(self, known=(*self.known, *self.unknown), unknown=())

    def with_inputs(self, known: Sequence[int], unknown: Sequence[int]) -> Equations:
        """Return the equations with some of the inputs alone, by index."""
        if (len(known), len(unknown)) == (len(self.known), len(self.unknown)):
            return self
        return replace(self, known=tuple(self.known[i] for i in known), unknown=tuple(self.unknown[j] for j in unknown))


def equations_of(
    model: Model,
    held: Mapping[str, float] | None = None,
    origin: Sequence[Fraction] | None = None,
    meaning: Callable[[float], Meaning] | None = None,
) -> Equations:
    """Return the model's equations with a symbol for every constant.

    held: known inputs kept at a value, which joins the drift; origin (n,): the equations are those of the state less origin pi,
    multiples of pi / 12, so that sine and cosine there are those of 0; meaning: what a double stands for (None: what was meant).
    """
    held, meaning = held or {}, meaning or meant
    require_known("held", tuple(held), model.input_names)
    levels = ca.SX.sym("held", len(held))
    columns = {name: i for i, name in enumerate(model.input_names)}
    n, q, m = model.x.numel(), len(model.outputs), len(model.inputs)
    graph = symbolise(model.x, ca.vertcat(model.h, ca.vec(ca.horzcat(model.drift, model.B, model.G))), meaning, origin)
    fields = ca.horzsplit(ca.reshape(graph.expression[q:], n, -1))
    return Equations(
        x=model.x,
        names=model.state_names,
        constants=ca.vertcat(graph.constants, levels),
        values=(*graph.values, *(meaning(float(value)) for value in held.values())),
        drift=fields[0] + sum((fields[1 + columns[name]] * levels[i] for i, name in enumerate(held)), ca.SX.zeros(n)),
        known=tuple(fields[1 + i] for name, i in columns.items() if name not in held),
        unknown=tuple(fields[m + 1 :]),
        outputs=graph.expression[:q],
        output_names=tuple(signal.name for signal in model.outputs),
        origin=tuple(origin or ()),
        read=(*graph.read, *((float(value), meaning(float(value))) for value in held.values())),
    )


def meant(value: float) -> Meaning:
    """Return what was meant by a double."""
    return read(value).meant


def typed(value: float) -> Meaning:
    """Return what a double stands for as it stands, where it may be a rounded one."""
    return read(value).typed


def with_input_states(equations: Equations, levels: int) -> Equations:
    """Return the equations with w, w', ..., w^(levels - 1) as states before x, and w^(levels) as the unknown input."""
    p = len(equations.unknown)
    jets = [ca.SX.sym(f"w{level}", p) for level in range(levels)]
    n = equations.n + p * levels
    added = ca.vertcat(*jets)
    zeros = ca.SX.zeros(p * levels)
    rate = equations.drift + sum((g * jets[0][j] for j, g in enumerate(equations.unknown)), ca.SX.zeros(equations.n))
    top = p * (levels - 1)
    return replace(
        equations,
        x=ca.vertcat(added, equations.x),
        names=(*(f"w{level}_{j}" for level in range(levels) for j in range(p)), *equations.names),
        drift=ca.vertcat(*jets[1:], ca.SX.zeros(p), rate),
        known=tuple(ca.vertcat(zeros, field) for field in equations.known),
        unknown=tuple(ca.SX([float(row == top + j) for row in range(n)]) for j in range(p)),
        extra=p * levels,
        origin=(*[Fraction(0)] * (p * levels * bool(equations.origin)), *equations.origin),
    )
