"""What outputs depend on at all: which states move an output in the end, and how many functions outputs and derivatives are."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from obsdesign.calculus import lie_derivative
from obsdesign.dynamics.model import Model

_MAX_NODES = 20_000
"""Derivatives of more nodes than this are not counted."""


def states_that_move_nothing(model: Model, held: Mapping[str, float]) -> tuple[str, ...]:
    """Return names of the states that are in no output and in the rate of no state that moves one: no derivative contains them."""
    rate, h = (_with_held(model, expression, held) for expression in (model.motion.at(model.u, model.w), model.h))
    sparsity = ca.jacobian(rate, model.x).sparsity()
    used_by = {i: {j for row, j in zip(sparsity.row(), sparsity.get_col(), strict=True) if row == i} for i in range(model.x.numel())}
    reached = set(ca.jacobian(h, model.x).sparsity().get_col())
    waiting = list(reached)
    while waiting:
        new = used_by[waiting.pop()] - reached
        reached |= new
        waiting += new
    return tuple(name for i, name in enumerate(model.state_names) if i not in reached)


def function_count(model: Model, held: Mapping[str, float]) -> int | None:
    """Return how many of the outputs and their derivatives without inputs are not constant; None where inputs vary, and from n on.

    sum over outputs of the number of k with L_f^k h not constant: a constant one is followed by zeros.
    """
    n, is_driven = len(model.states), any(name not in held for name in model.input_names)
    if is_driven or model.unknown_inputs or model.period is not None:
        return None
    rate, h = (_with_held(model, expression, held) for expression in (model.rate, model.h))
    count = 0
    for function in ca.vertsplit(h):
        while count < n and not _is_constant(function, model.x):
            count += 1
            function = lie_derivative(function, model.x, rate)  # noqa: PLW2901  # the next derivative
            if ca.n_nodes(function) > _MAX_NODES:
                return None
    return count if count < n else None


def _with_held(model: Model, expression: ca.SX, held: Mapping[str, float]) -> ca.SX:
    """Return the expression with the held inputs at their values."""
    places = [i for i, name in enumerate(model.input_names) if name in held]
    values = ca.DM([held[model.input_names[i]] for i in places])
    return ca.simplify(ca.substitute(expression, model.u[places], ca.SX(values))) if places else expression


def _is_constant(function: ca.SX, x: ca.SX) -> bool:
    gradient = ca.simplify(ca.jacobian(function, x))
    return gradient.nnz() == 0 or gradient.is_zero()
