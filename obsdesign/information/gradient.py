"""How information changes with the inputs: one walk forwards, one back, whatever the number of inputs."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import all_finite, require_positive, require_tolerance
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import as_known_and_unknown, as_scale, as_state, side_by_side, simulate, substeps_needed
from obsdesign.dynamics.step import CACHED
from obsdesign.errors import InputError
from obsdesign.information.accumulation import Walk, stepped, walk_of
from obsdesign.information.gramian import require_sensors, variational_gramian
from obsdesign.round_off import may_be_singular
from obsdesign.trajectory import TOLERANCE


@validate_arguments
def information_value(
    system: AbstractSystem,
    x0: ArrayLike,
    u: ArrayLike,
    dt: float,
    criterion: AbstractCriterion,
    scale: ArrayLike | None = None,
    *,
    w: ArrayLike | None = None,
    tolerance: float = TOLERANCE,
) -> float:
    """Return criterion(S W S) of the path from an initial state under given inputs, W its variational Gramian.

    Arguments:
        system: vehicle and sensors.
        x0 (n,): initial state, in the units of the states.
        u (N, m): known inputs, held over each step, in their units.
        dt: length of a step [s].
        criterion: what is asked of S W S.
        scale (n,): the diagonal of S, what counts as one unit of each state; None = ones.
        w (N, p): unknown inputs, in their units; None = 0.
        tolerance: relative error of the steps, as in simulate.
    Raises InputError as simulate and variational_gramian.
    """
    start, known, unknown, S = _checked(system, x0, u, w, dt, scale)
    require_tolerance(tolerance)
    substeps = int(substeps_needed(system, start[None], known, dt, unknown, tolerance)[0])
    walk, carry, _, _ = _walked(system, start, known, unknown, dt, substeps, carries=False)
    W = walk.sums(carry)[0].sum(axis=0) * S[:, None] * S
    return criterion.value(_without_residues(W, system, start, known, dt, unknown, tolerance, S))


def _without_residues(  # noqa: PLR0917  # what the path is made of
    W: np.ndarray, system: AbstractSystem, start: np.ndarray, u: np.ndarray, dt: float, w: np.ndarray, tolerance: float, S: np.ndarray
) -> np.ndarray:
    """Return S W S (n, n), exactly 0 along what is round-off: only the rows of the path can tell."""
    if not may_be_singular(W):
        return W
    return variational_gramian(system, simulate(system, start, u, dt, w, tolerance=tolerance)).sight.information * S[:, None] * S


@validate_arguments
def information_gradient(
    system: AbstractSystem,
    x0: ArrayLike,
    u: ArrayLike,
    dt: float,
    criterion: AbstractCriterion,
    scale: ArrayLike | None = None,
    *,
    w: ArrayLike | None = None,
    tolerance: float = TOLERANCE,
) -> tuple[float, np.ndarray]:
    """Return criterion(S W S) and its gradient (N, m) with respect to the known inputs, per unit of each.

    The adjoint of the recursion (x, Phi, W): with Z the criterion's slope, d value = <Z, dW>, x and Phi (and what is remembered of
    errors that are not independent) are carried back from the last step to the first. Where eigenvalues coincide the slope of
    lambda_min is one of its supergradients.

    Arguments:
        system: vehicle and sensors.
        x0 (n,): initial state, in the units of the states.
        u (N, m): known inputs, held over each step, in their units.
        dt: length of a step [s].
        criterion: what is asked of S W S.
        scale (n,): the diagonal of S, what counts as one unit of each state; None = ones.
        w (N, p): unknown inputs, in their units; None = 0.
        tolerance: relative error of the steps, as in simulate.
    Raises InputError as information_value, and where the criterion has no value (-inf).
    """
    start, known, unknown, S = _checked(system, x0, u, w, dt, scale)
    require_tolerance(tolerance)
    substeps = int(substeps_needed(system, start[None], known, dt, unknown, tolerance)[0])
    walk, carry, carries, taken = _walked(system, start, known, unknown, dt, substeps, carries=True)
    W = walk.sums(carry)[0].sum(axis=0) * S[:, None] * S
    W = _without_residues(W, system, start, known, dt, unknown, tolerance, S)
    value = criterion.value(W)
    if not np.isfinite(value):
        raise InputError(f"{type(criterion).__name__} is {value} along this path: it has no gradient there")
    Z = criterion.slope(W) * S[:, None] * S
    moving = len(start) + len(walk.start)
    before = np.concatenate([walk.first(start[None]), carries[:-1]])[:, :moving]
    reversed_rows = [row[::-1] for row in (before, side_by_side(known, unknown), *taken)]
    rows = [*reversed_rows, Z.ravel()]
    adjoint = _back(system.model, dt, substeps).run(np.zeros((1, moving)), rows, len(before), carries=False)
    return value, adjoint.results[0][0, ::-1].copy()


def _checked(
    system: AbstractSystem, x0: ArrayLike, u: ArrayLike, w: ArrayLike | None, dt: float, scale: ArrayLike | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return x0 (n,), u (N, m), w (N, p) and the scale (n,) as arrays, or raise InputError."""
    require_positive("dt", dt)
    require_sensors(system)
    known, unknown = as_known_and_unknown(system, u, w)
    return as_state(system, x0, "x0"), known, unknown, as_scale(system, scale)


def _walked(
    system: AbstractSystem, start: np.ndarray, u: np.ndarray, w: np.ndarray, dt: float, substeps: int, *, carries: bool
) -> tuple[Walk, np.ndarray, np.ndarray, list[np.ndarray]]:
    """Return the walk, its last carry (1, c), the carries (N, c) if wanted, and who samples."""
    walk = walk_of(system.model, dt, substeps)
    taken = walk.taken(system, len(u), dt)
    run = walk.scan.run(walk.first(start[None]), [u, w, *taken], len(u), carries=carries)
    if not all_finite(run.carry):
        variational_gramian(system, simulate(system, start, u, dt, w))  # says what is wrong, and where
    return walk, run.carry, run.carries[0], taken


@lru_cache(CACHED)
def _back(model: Model, dt: float, substeps: int) -> Scan:
    """(adjoint of x, of the carry) at t_k+1 -> at t_k; rows (x, carry)_k, (u, w)_k, who samples, Z; result: the gradient (m,) to u_k."""
    one, n = stepped(model, dt, substeps), len(model.states)
    state, state_next = ca.vertcat(one.x, one.carry), ca.vertcat(one.x_next, one.carry_next)
    Z, later = ca.SX.sym("Z", n * n), ca.SX.sym("adjoint", state.numel())
    potential = ca.dot(ca.reshape(Z, n, n), sum(one.blocks, ca.SX(n, n))) + ca.dot(later, state_next)
    slopes = ca.gradient(potential, ca.vertcat(state, one.u))
    return Scan(later, [state, one.held, *one.taken, Z], slopes[: state.numel()], [slopes[state.numel() :]])
