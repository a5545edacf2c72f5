"""Limits and costs at the nodes of a path, with first and second derivatives to (x, u) there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.calculus import rk4
from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.costs.abstract import AbstractCost
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.step import CACHE_SIZE
from obsdesign.moment import Moment, NoRates
from obsdesign.packing import pack, unpack


@dataclass(frozen=True, eq=False)
class NodeFunctions:
    """Margins at a node (x, u) and what costs come to per second of the step that begins there, side by side: (r,).

    owner (r,): the index of each one's constraint, then cost; of_inputs (r,): whether it depends on the inputs there.
    """

    value_scan: Scan
    gradient_scan: Scan
    hessian_scan: Scan
    owner: tuple[int, ...]
    constraint_count: int
    margin_count: int
    of_inputs: tuple[bool, ...]

    def values(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return (K, r) at K nodes x (K, n), u (K, m)."""
        return self.value_scan.run(_NOTHING, [x, u], len(x), carries=False).results[0][0]

    def least(self, values: np.ndarray) -> np.ndarray:
        """Return the least margin of each constraint (..., c) of values (..., r); inf of one that limits nothing."""
        owner = np.array(self.owner, dtype=int)
        columns = [values[..., owner == i].min(axis=-1, initial=np.inf) for i in range(self.constraint_count)]
        return np.stack(columns, axis=-1) if columns else np.empty((*values.shape[:-1], 0))

    def gradients(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return derivatives (K, r, n + m) to (x, u)."""
        v = x.shape[1] + u.shape[1]
        return self.gradient_scan.run(_NOTHING, [x, u], len(x), carries=False).results[0][0].reshape(len(x), -1, v)

    def hessians(self, x: np.ndarray, u: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return gradient (K, v) and Hessian (K, v, v) of weights' values, weights (K, r)."""
        g, H = self.hessian_scan.run(_NOTHING, [x, u, weights], len(x), carries=False).results
        return g[0], unpack(H[0], g.shape[-1])


_NOTHING = np.empty((1, 0))
_POINTS, _SUBSTEP_POINTS = 5, 3  # of Gauss in a step, and in each of its sub-steps where it has several


@lru_cache(CACHE_SIZE)
def node_functions_of(
    model: Model, constraints: tuple[AbstractConstraint, ...], costs: tuple[AbstractCost, ...] = (), pace: tuple[float, int] = (0.0, 1)
) -> NodeFunctions:
    """Return the functions of a model's constraints and costs; pace: seconds of a step, and of how many sub-steps it is made."""
    moment = moment_of(model)
    parts = [constraint.margins(moment) for constraint in constraints] + [[_mean_rate(model, cost, *pace)] for cost in costs]
    owner = tuple(i for i, part in enumerate(parts) for _ in part)
    functions = ca.vertcat(*[ca.SX(value) for part in parts for value in part]) if owner else ca.SX(0, 1)
    variables, weights, empty = ca.vertcat(model.x, model.u), ca.SX.sym("weights", len(owner)), ca.SX(0, 1)
    H, g = ca.hessian(ca.dot(weights, functions), variables)
    rows = [model.x, model.u]
    return NodeFunctions(
        value_scan=Scan(empty, rows, empty, [functions]),
        gradient_scan=Scan(empty, rows, empty, [ca.vec(ca.densify(ca.jacobian(functions, variables)).T)]),
        hessian_scan=Scan(empty, [*rows, weights], empty, [ca.densify(g), pack(ca.densify(H))]),
        owner=owner,
        constraint_count=len(constraints),
        margin_count=sum(i < len(constraints) for i in owner),
        of_inputs=tuple(bool(ca.depends_on(value, model.u)) for value in ca.vertsplit(functions))
        if owner and model.inputs
        else (False,) * len(owner),
    )


def moment_of(model: Model) -> Moment:
    """Return the symbolic moment at (x, u), unknown inputs 0."""
    states = model.state_names
    return Moment(
        dict(zip(states, ca.vertsplit(model.x), strict=True)),
        NoRates(states) if model.period is not None else dict(zip(states, ca.vertsplit(ca.densify(model.undisturbed_rate)), strict=True)),
        dict(zip(model.input_names, ca.vertsplit(model.u), strict=True)) if model.inputs else {},
        model.landmarks,
    )


def rate_within_steps(model: Model) -> ca.SX:
    """Return how the state moves between instants, w = 0: not at all where the model is a map from one to the next."""
    return ca.SX.zeros(model.x.numel()) if model.period is not None else model.undisturbed_rate


def _mean_rate(model: Model, cost: AbstractCost, step: float, substeps: int) -> ca.SX:
    """Return the mean of a cost's rate over a step from x with u held.

    Gauss's rule in every sub-step, its states by RK4 from where it begins. With p points it is off by
    (p!)^4 / ((2 p + 1) (2 p)!^3) h^2p max |d^2p rate / dt^2p|: for p = 5 and a rate that turns by w h in h seconds, 4e-13 (w h)^10 of it.
    """
    rate = ca.Function("cost", [model.x, model.u], [ca.SX(cost.rate(moment_of(model)))])
    drift = ca.Function("rate", [model.x, model.u], [rate_within_steps(model)])
    if not ca.depends_on(ca.SX(rate(model.x, model.u)), model.x):
        return ca.SX(rate(model.x, model.u))
    points, weights = np.polynomial.legendre.leggauss(_POINTS if substeps == 1 else _SUBSTEP_POINTS)
    h, x, total = step / substeps, model.x, ca.SX(0)

    def advance(begin: ca.SX, seconds: float) -> ca.SX:
        """Return the state `seconds` after `begin`, by one step of RK4."""
        return rk4(lambda x: ca.SX(drift(x, model.u)), begin, seconds)

    for _ in range(substeps):
        total += sum(
            float(weight) / 2 * ca.SX(rate(advance(x, h * (1 + point) / 2), model.u)) for point, weight in zip(points, weights, strict=True)
        )
        x = advance(x, h)
    return total / substeps
