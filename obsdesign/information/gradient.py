"""How information changes with the inputs: one walk forwards, one back, whatever the number of inputs."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import require_positive
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.errors import InputError
from obsdesign.information.gramian import require_sensors, variational_gramian
from obsdesign.information.sampling import sampled
from obsdesign.information.totals import batch_information, stepped, walk_of
from obsdesign.model import AbstractSystem, Model
from obsdesign.scan import Scan
from obsdesign.simulation import as_inputs, as_state, simulate
from obsdesign.step import CACHED


def information_value(
    system: AbstractSystem, x0: ArrayLike, u: ArrayLike, dt: float, criterion: AbstractCriterion, scale: ArrayLike | None = None
) -> float:
    """Return criterion(S W S) of the path from x0 (n,) under u (N, m); scale (n,): the diagonal of S, None = ones.

    Raises InputError as simulate and variational_gramian.
    """
    start, S = as_state(system, x0, "x0"), _units(system, scale)
    total = batch_information(system, start[None], as_inputs(u, len(system.model.inputs), "u"), dt)[0].sum(axis=0)
    return criterion.value(total * S[:, None] * S)


def information_gradient(
    system: AbstractSystem, x0: ArrayLike, u: ArrayLike, dt: float, criterion: AbstractCriterion, scale: ArrayLike | None = None
) -> tuple[float, np.ndarray]:
    """Return criterion(S W S) and its gradient (N, m) with respect to the inputs u (N, m).

    The adjoint of the walk (x, Phi, W): with Z the criterion's slope, d value = <Z, dW>, x and Phi are carried back from
    the last step to the first. Where eigenvalues coincide the slope of lambda_min is one of its supergradients.
    Raises InputError as information_value, and where the criterion has no value (-inf).
    """
    require_positive("dt", dt)
    require_sensors(system)
    start, inputs, S = as_state(system, x0, "x0"), as_inputs(u, len(system.model.inputs), "u"), _units(system, scale)
    if not len(inputs):
        raise InputError("u has no steps: needs at least 1")
    walk, back = walk_of(system.model, dt), _back(system.model, dt)
    due = [sampled(system, len(inputs), dt).astype(float)] if walk.masked else []
    idle = np.zeros(len(system.model.unknown_inputs))
    first = walk.first(start[None])
    run = walk.scan.run(first, [inputs, idle, *due], len(inputs))
    if not np.isfinite(run.carry).all():
        variational_gramian(system, simulate(system, start, inputs, dt))
    W = walk.sums(run.carry)[0].sum(axis=0) * S[:, None] * S
    value = criterion.value(W)
    if not np.isfinite(value):
        raise InputError(f"{type(criterion).__name__} is {value} along this path: it has no gradient there")
    Z = criterion.slope(W) * S[:, None] * S
    moving = len(start) + len(walk.shape.start)
    before = np.concatenate([first, run.carries[0, :-1]])[:, :moving]
    reversed_rows = [row[::-1] for row in (before, inputs, *due)]
    adjoint = back.run(np.zeros((1, moving)), [*reversed_rows, Z.ravel()], len(inputs), carries=False)
    return value, adjoint.results[0][0, ::-1].copy()


def _units(system: AbstractSystem, scale: ArrayLike | None) -> np.ndarray:
    names = system.model.state_names
    units = np.ones(len(names)) if scale is None else as_state(system, scale, "scale")
    for name, unit in zip(names, units, strict=True):
        require_positive(f"scale of {name}", float(unit))
    return units


@lru_cache(CACHED)
def _back(model: Model, dt: float) -> Scan:
    """(adjoint of x, of Phi) at t_k+1 -> at t_k; rows (x, Phi)_k, u_k, who samples, Z; result: the gradient (m,) to u_k."""
    one, n = stepped(model, dt), len(model.states)
    state, zero = ca.vertcat(one.x, one.Phi), ca.SX.zeros(one.w.numel())
    state_next = ca.vertcat(one.x_next, one.Phi_next)
    state_next = ca.substitute(state_next, one.w, zero) if one.w.numel() else state_next
    Z, later = ca.SX.sym("Z", n * n), ca.SX.sym("adjoint", state.numel())
    potential = ca.dot(ca.reshape(Z, n, n), sum(one.blocks, ca.SX(n, n))) + ca.dot(later, state_next)
    slopes = ca.gradient(potential, ca.vertcat(state, one.u))
    return Scan(later, [state, one.u, *one.due, Z], slopes[: state.numel()], [slopes[state.numel() :]])
