"""What rounding does to the rows C Phi of a path: the first-order effect of an error in every number and every operation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.common_subexpressions import without_repeats
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.step import CACHE_SIZE, Sensitivity, step_of
from obsdesign.rank.graph import instructions

_N_ANGLES = (
    4  # 8 draws: were they independent and normal, a mean of squares would be right within sqrt(2 / 8), a half; work grows with them
)
DRAWS = 2 * _N_ANGLES  # of all errors: the size of what they do to a direction is a mean over these
_BITS = 30  # a number that has no more is taken for exact: by chance one in eight million has
_POWERS = {ca.OP_POW, ca.OP_CONSTPOW}
_NAMES = "INPUT OUTPUT CONST NEG TWICE FABS SIGN FLOOR CEIL LT LE EQ NE NOT AND OR IF_ELSE_ZERO FMIN FMAX"
_WITHOUT_ERROR = {getattr(ca, f"OP_{name}") for name in _NAMES.split()}


@dataclass(frozen=True, eq=False)
class RoundingScan:
    """(x_k's error, Phi, Phi's error) one step later; rows x, (u, w); results: C Phi (q, n) by columns, its error, sqrt(g/R) (q,)."""

    scan: Scan
    sensitivity: Sensitivity

    def initial_carry(self, sizes: np.ndarray) -> np.ndarray:
        """Return the carry (1, c) at the start, with an error in each state of the size (n,) of its typed numbers."""
        errors = sizes[:, None] * _draws(0, len(sizes))
        start = self.sensitivity.start
        return np.concatenate([errors.ravel(order="F"), start, np.zeros(len(start) * DRAWS)])[None]


def decimal_sizes(model: Model, x: np.ndarray) -> np.ndarray:
    """Return the size (n,) of the numbers that each component of the start x (n,) was typed with.

    The coordinates of a point come out of each other, 2000 cos(pi/2) beside 2000 sin(pi/2): states of one unit share the largest.
    An angle counts as 1 rad at least.
    """
    sizes = np.abs(x)
    for i, state in enumerate(model.states):
        magnitudes_of_unit = [
            abs(value) for value, second_state in zip(x, model.states, strict=True) if state.unit and second_state.unit == state.unit
        ]
        sizes[i] = max([sizes[i], float(state.is_angle), *magnitudes_of_unit])
    return sizes


@lru_cache(CACHE_SIZE)
def rounding_scan(model: Model, step: float, substeps: int) -> RoundingScan:
    """Return the walk along a path that carries the errors of states and sensitivities, relative to the unit of rounding.

    With a factor 1 + theta_o at the result of each operation, and at each constant and input that may have been rounded, the
    derivative to theta in a direction drawn at random, DRAWS times: the mean square over the draws is that of independent errors.
    """
    step_graph = step_of(model, step, substeps)
    sensitivity = step_graph.sensitivity
    n, c, q = len(model.states), sensitivity.free.numel(), model.h.numel()
    output_rows = ca.jacobian(model.h, model.x) @ sensitivity.Phi
    symbols = [step_graph.x, step_graph.all_inputs, sensitivity.free]
    exact = ca.densify(ca.vertcat(step_graph.x_next, sensitivity.free_next, ca.vec(output_rows)))
    perturbed, theta = _perturb_operations(symbols, exact, _coordinate_sizes(model))
    x_error, Phi_error = ca.SX.sym("dx", n, DRAWS), ca.SX.sym("dPhi", c, DRAWS)
    draws = _draws(n, theta.numel())
    causes = ca.vertcat(step_graph.x, sensitivity.free, theta)
    errors = ca.jtimes(perturbed, causes, ca.vertcat(x_error, Phi_error, ca.DM(draws)))
    errors = ca.densify(ca.substitute(errors, theta, ca.SX.zeros(theta.numel())))
    noises = [(channel.noise, len(channel.outputs)) for channel in model.channels]
    weight = ca.vertcat(*[ca.SX.ones(count) * ca.sqrt(noise.gate / noise.variance) for noise, count in noises])
    carry = ca.vertcat(ca.vec(x_error), sensitivity.free, ca.vec(Phi_error))
    carry_next = ca.vertcat(ca.vec(errors[:n, :]), sensitivity.free_next, ca.vec(errors[n : n + c, :]))
    results = [ca.vec(ca.densify(output_rows)), ca.vec(errors[n + c : n + c + q * n, :]), weight]
    return RoundingScan(Scan(carry, [step_graph.x, step_graph.all_inputs], carry_next, results), sensitivity)


def _coordinate_sizes(model: Model) -> dict[float, float]:
    """Coordinates of landmarks, with the size that each was typed with, as a multiple of its own."""
    sizes: dict[float, float] = {}
    for point in model.landmarks:
        for value in point:
            if value:
                sizes[abs(value)] = max(sizes.get(abs(value), 1.0), max(map(abs, point)) / abs(value))
    return sizes


def _perturb_operations(symbols: list[ca.SX], expression: ca.SX, coordinates: dict[float, float]) -> tuple[ca.SX, ca.SX]:
    """Return the column with a factor 1 + theta at each number that is rounded, and theta (t, 1)."""
    steps = instructions(ca.Function("exact", symbols, without_repeats([expression])))
    arguments = [ca.vertsplit(symbol) for symbol in symbols]
    numbers = {step.value for step in steps if step.operation == ca.OP_CONST and math.frexp(step.value)[0] * 2**_BITS % 1}
    noise = iter(ca.vertsplit(ca.SX.sym("theta", len(steps) + len(numbers))))
    theta_of_number = {number: next(noise) for number in sorted(numbers)}
    thetas, work, constants, result = [*theta_of_number.values()], {}, {}, {}

    def factor_of(source: int, exponent: bool) -> ca.SX:
        """Return an operand, a constant perturbed by its own rounding."""
        theta = None if exponent else theta_of_number.get(constants[source])
        return work[source] if theta is None else work[source] * (1 + coordinates.get(abs(constants[source]), 1.0) * theta)

    for operation, target, sources, value in steps:
        if operation == ca.OP_INPUT:
            value_graph = arguments[sources[0]][sources[1]]
        elif operation == ca.OP_CONST:
            value_graph = ca.SX(value)
        else:
            factors = [factor_of(source, operation in _POWERS and i == 1) for i, source in enumerate(sources)]
            value_graph = factors[0] if operation == ca.OP_OUTPUT else _apply(operation, factors)
            if operation not in _WITHOUT_ERROR:
                thetas.append(next(noise))
                value_graph *= 1 + thetas[-1]
        (result if operation == ca.OP_OUTPUT else work)[target] = value_graph
        if operation != ca.OP_OUTPUT:
            constants[target] = value if operation == ca.OP_CONST else 0.0
    return ca.vertcat(*[result[k] for k in range(len(result))]), ca.vertcat(*thetas)


def _draws(first: int, count: int) -> np.ndarray:
    """Return (count, DRAWS), cosines and sines of angles that go with the causes of errors from number `first` on.

    Each cause has the mean square 1. The angles go round by irrational shares of a turn that have nothing to do with each other
    (powers of the root of g^5 = g + 1: Roberts' sequence), so that no two causes cancel in all of them.
    """
    g = 1.1673039782614187
    turns = np.arange(first, first + count)[:, None] * g ** -np.arange(1.0, _N_ANGLES + 1)
    angles = 2 * np.pi * (turns % 1)
    return np.sqrt(2) * np.hstack([np.cos(angles), np.sin(angles)])


def _apply(operation: int, factors: list[ca.SX]) -> ca.SX:
    return ca.SX.unary(operation, *factors) if len(factors) == 1 else ca.SX.binary(operation, *factors)
