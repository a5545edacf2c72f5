"""What the analysis works on: bare expressions whose constants are symbols with exact values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from itertools import accumulate

import casadi as ca
import flint

from obsdesign.analysis.evaluation_point import EvaluationPoint, SamplingRegion, random_fractions
from obsdesign.rank.balls import PRECISIONS
from obsdesign.rank.elimination import values_at
from obsdesign.rank.exact_numbers import ExactNumber, Number
from obsdesign.rank.graph import Instruction, has_pieces, instructions, is_rational
from obsdesign.rank.map_flow import MapFlow
from obsdesign.rank.piecewise_functions import smooth_near
from obsdesign.rank.symbol_relations import FunctionArguments, function_arguments
from obsdesign.rank.taylor import Flow

ExactValues = tuple[ExactNumber, ...]


@dataclass(frozen=True, eq=False)
class Piece:
    """One piece of functions of n states: (x, constants) -> their values on this piece, and on the piece where x lies."""

    n: int
    on_piece: ca.Function
    everywhere: ca.Function
    constants: ExactValues

    def contains(self, state: Sequence[Number]) -> bool:
        """Return whether the state (..., n), perhaps behind added ones, lies in this piece."""
        arguments = (state[len(state) - self.n :], self.constants)
        with flint.ctx.workprec(PRECISIONS[1]):
            on_piece, everywhere = (values_at(function, arguments) for function in (self.on_piece, self.everywhere))
        return all(a.overlaps(b) for rows in zip(on_piece, everywhere, strict=True) for a, b in zip(*rows, strict=True))


@dataclass(frozen=True, eq=False)
class Equations:
    """xdot = drift + sum_i known_i u_i + sum_j unknown_j w_j, y = outputs (q, 1); fields are SX (n, 1).

    constants (c, 1): symbols for the numbers in all of these, with their values; n_added: how many states come first that
    were added, and are not asked for; origin (n,): x is the state that was asked about less origin pi; readings: doubles of the
    model, each with what it stands for; piece: which one these are, where functions have pieces. step_map: of a map from one instant to
    the next, which drift and outputs are for some values of the inputs; the fields then only count these. known_at_start: states that
    are asked for, by place among these, and known at the instant that is asked about.
    """

    x: ca.SX
    names: tuple[str, ...]
    constants: ca.SX
    values: ExactValues
    drift: ca.SX
    known_fields: tuple[ca.SX, ...]
    unknown_fields: tuple[ca.SX, ...]
    outputs: ca.SX
    output_names: tuple[str, ...]
    n_added: int = 0
    origin: tuple[Fraction, ...] = ()
    readings: tuple[tuple[float, ExactNumber], ...] = ()
    piece: Piece | None = None
    step_map: MapFlow | None = None
    known_at_start: tuple[int, ...] = ()

    @property
    def n(self) -> int:
        """Number of states."""
        return self.x.numel()

    @property
    def n_queried(self) -> int:
        """Number of states that are asked for."""
        return self.n - self.n_added

    @cached_property
    def all_expressions(self) -> ca.Function:
        """(x, constants) -> outputs, drift, known and unknown fields in one column."""
        return self.function(ca.densify(ca.vertcat(self.outputs, self.drift, *self.known_fields, *self.unknown_fields)))

    @cached_property
    def _steps(self) -> tuple[Instruction, ...]:
        return instructions(self.all_expressions)

    @cached_property
    def is_rational(self) -> bool:
        """Whether all expressions are quotients of polynomials with rational coefficients."""
        return is_rational(self._steps)

    @property
    def has_pieces(self) -> bool:
        """Whether some expression is another function elsewhere."""
        return has_pieces(self._steps)

    @cached_property
    def symbols_used(self) -> FunctionArguments:
        """The functions in these expressions that are symbols modulo a prime."""
        return function_arguments(self._steps, (self.x, self.constants))

    def smooth_near(self, point: Sequence[Number]) -> Equations:
        """Return the equations without pieces that are these near a state (n,). Raises NoValueError on the border of pieces."""
        column = smooth_near(self.all_expressions, (self.x, self.constants), (point, self.values))
        lengths = [self.outputs.numel(), *[self.n] * (1 + len(self.known_fields) + len(self.unknown_fields))]
        outputs, drift, *fields = ca.vertsplit(column, [0, *accumulate(lengths)])
        known_fields, unknown_fields = tuple(fields[: len(self.known_fields)]), tuple(fields[len(self.known_fields) :])
        smooth = replace(self, outputs=outputs, drift=drift, known_fields=known_fields, unknown_fields=unknown_fields)
        return replace(smooth, piece=Piece(self.n, smooth.all_expressions, self.all_expressions, self.values))

    @property
    def map_flow(self) -> MapFlow:
        """The map. Raises ValueError where time is continuous."""
        if self.step_map is None:
            raise ValueError("time is continuous: there is no map")
        return self.step_map

    @cached_property
    def flow(self) -> Flow | MapFlow:
        """The equations with symbols for the inputs."""
        return self.step_map or self.differential_flow

    @cached_property
    def differential_flow(self) -> Flow:
        """The differential equations with symbols for the inputs."""
        u, w = ca.SX.sym("u", len(self.known_fields)), ca.SX.sym("w", len(self.unknown_fields))
        pairs = [*zip(self.known_fields, ca.vertsplit(u), strict=True), *zip(self.unknown_fields, ca.vertsplit(w), strict=True)]
        rate = self.drift + sum((field * symbol for field, symbol in pairs), ca.SX.zeros(self.n))
        return Flow(self.x, u, w, self.constants, rate, self.outputs)

    @property
    def drift_and_known_fields(self) -> tuple[ca.SX, ...]:
        """Drift and known fields, those that vanish left out."""
        return tuple(field for field in (self.drift, *self.known_fields) if not field.is_zero())

    def place_of(self, point: EvaluationPoint, seed: int) -> EvaluationPoint:
        """Return where a state (n - n_added,) is that was asked about, behind random added ones."""
        place = replace(point, state=(*random_fractions(self.n_added, f"{seed} extra"), *point.state))
        return place.relative_to(self.origin) if self.origin else place

    def original_state(self, point: EvaluationPoint) -> EvaluationPoint:
        """Return the state that was asked about, of which the place is what these equations make."""
        return point.relative_to([-multiple_of_pi for multiple_of_pi in self.origin]) if self.origin else point

    def region(self, seed: int, point: EvaluationPoint | None = None) -> SamplingRegion:
        """Return where generic states are drawn that are asked about: anywhere, or near a place (n,)."""
        return SamplingRegion(self.n_queried, seed, point and replace(point, state=point.state[self.n_added :]))

    def describe(self, point: EvaluationPoint) -> str:
        """Say where the place is."""
        return self.original_state(point).in_words(self.names)

    def function(self, expression: ca.SX) -> ca.Function:
        """Return (x, constants) -> expression."""
        return ca.Function("expression", [self.x, self.constants], [expression])

    def with_all_inputs_known(self) -> Equations:
        """Return the equations as they are for somebody who knows the unknown inputs."""
        step_map = self.step_map and replace(self.step_map, u=ca.vertcat(self.step_map.u, self.step_map.w), w=ca.SX(0, 1))
        return replace(self, known_fields=(*self.known_fields, *self.unknown_fields), unknown_fields=(), step_map=step_map)

    def with_inputs(self, known_indices: Sequence[int], unknown_indices: Sequence[int]) -> Equations:
        """Return the equations with some of the inputs alone, by index."""
        if (len(known_indices), len(unknown_indices)) == (len(self.known_fields), len(self.unknown_fields)):
            return self
        return replace(
            self,
            known_fields=tuple(self.known_fields[i] for i in known_indices),
            unknown_fields=tuple(self.unknown_fields[j] for j in unknown_indices),
        )


def with_input_states(equations: Equations, levels: int) -> Equations:
    """Return the equations with w, w', ..., w^(levels - 1) as states before x, and w^(levels) as the unknown input."""
    p = len(equations.unknown_fields)
    input_jets = [ca.SX.sym(f"w{level}", p) for level in range(levels)]
    n = equations.n + p * levels
    added_states = ca.vertcat(*input_jets)
    zeros = ca.SX.zeros(p * levels)
    rate = equations.drift + sum((g * input_jets[0][j] for j, g in enumerate(equations.unknown_fields)), ca.SX.zeros(equations.n))
    highest_row = p * (levels - 1)
    return replace(
        equations,
        x=ca.vertcat(added_states, equations.x),
        names=(*(f"w{level}_{j}" for level in range(levels) for j in range(p)), *equations.names),
        drift=ca.vertcat(*input_jets[1:], ca.SX.zeros(p), rate),
        known_fields=tuple(ca.vertcat(zeros, field) for field in equations.known_fields),
        unknown_fields=tuple(ca.SX([float(row == highest_row + j) for row in range(n)]) for j in range(p)),
        n_added=equations.n_added + p * levels,
        origin=(*[Fraction(0)] * (p * levels * bool(equations.origin)), *equations.origin),
    )
