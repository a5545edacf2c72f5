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
from obsdesign.dynamics.simulation import as_input_arrays, as_scale, as_state, join_inputs, simulate, substeps_needed
from obsdesign.dynamics.step import CACHE_SIZE
from obsdesign.errors import InputError
from obsdesign.information.accumulation import Accumulator, information_step, simulating_accumulator
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
    start, u_known, w_unknown, S = _as_arrays(system, x0, u, w, dt, scale)
    require_tolerance(tolerance)
    substeps = int(substeps_needed(system, start[None], u_known, dt, w_unknown, tolerance)[0])
    accumulator, carry, _, _ = _accumulate(system, start, u_known, w_unknown, dt, substeps, carries=False)
    W = accumulator.sums(carry)[0].sum(axis=0) * S[:, None] * S
    return criterion.value(_without_round_off(W, system, start, u_known, dt, w_unknown, tolerance, S))


def _without_round_off(  # noqa: PLR0917  # what the path is made of
    W: np.ndarray, system: AbstractSystem, start: np.ndarray, u: np.ndarray, dt: float, w: np.ndarray, tolerance: float, S: np.ndarray
) -> np.ndarray:
    """Return S W S (n, n), exactly 0 along what is round-off: only the rows of the path can tell."""
    if not may_be_singular(W):
        return W
    return variational_gramian(system, simulate(system, start, u, dt, w, tolerance=tolerance)).visibility.information * S[:, None] * S


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
    start, u_known, w_unknown, S = _as_arrays(system, x0, u, w, dt, scale)
    require_tolerance(tolerance)
    substeps = int(substeps_needed(system, start[None], u_known, dt, w_unknown, tolerance)[0])
    accumulator, carry, carries, sampling = _accumulate(system, start, u_known, w_unknown, dt, substeps, carries=True)
    W = accumulator.sums(carry)[0].sum(axis=0) * S[:, None] * S
    W = _without_round_off(W, system, start, u_known, dt, w_unknown, tolerance, S)
    value = criterion.value(W)
    if not np.isfinite(value):
        raise InputError(f"{type(criterion).__name__} is {value} along this path: it has no gradient there")
    Z = criterion.slope(W) * S[:, None] * S
    carry_size = len(start) + len(accumulator.start)
    carries_before = np.concatenate([accumulator.initial_carry(start[None]), carries[:-1]])[:, :carry_size]
    reversed_rows = [row[::-1] for row in (carries_before, join_inputs(u_known, w_unknown), *sampling)]
    rows = [*reversed_rows, Z.ravel()]
    adjoint = _adjoint_scan(system.model, dt, substeps).run(np.zeros((1, carry_size)), rows, len(carries_before), carries=False)
    return value, adjoint.results[0][0, ::-1].copy()


def _as_arrays(
    system: AbstractSystem, x0: ArrayLike, u: ArrayLike, w: ArrayLike | None, dt: float, scale: ArrayLike | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return x0 (n,), u (N, m), w (N, p) and the scale (n,) as arrays, or raise InputError."""
    require_positive("dt", dt)
    require_sensors(system)
    u_known, w_unknown = as_input_arrays(system, u, w)
    return as_state(system, x0, "x0"), u_known, w_unknown, as_scale(system, scale)


def _accumulate(
    system: AbstractSystem, start: np.ndarray, u: np.ndarray, w: np.ndarray, dt: float, substeps: int, *, carries: bool
) -> tuple[Accumulator, np.ndarray, np.ndarray, list[np.ndarray]]:
    """Return the walk, its last carry (1, c), the carries (N, c) if wanted, and who samples."""
    accumulator = simulating_accumulator(system.model, dt, substeps)
    sampling = accumulator.sampling_rows(system, len(u), dt)
    run = accumulator.scan.run(accumulator.initial_carry(start[None]), [u, w, *sampling], len(u), carries=carries)
    if not all_finite(run.carry):
        variational_gramian(system, simulate(system, start, u, dt, w))  # says what is wrong, and where
    return accumulator, run.carry, run.carries[0], sampling


@lru_cache(CACHE_SIZE)
def _adjoint_scan(model: Model, dt: float, substeps: int) -> Scan:
    """(adjoint of x, of the carry) at t_k+1 -> at t_k; rows (x, carry)_k, (u, w)_k, who samples, Z; result: the gradient (m,) to u_k."""
    step_graph, n = information_step(model, dt, substeps, has_derivatives=True), len(model.states)
    state, state_next = ca.vertcat(step_graph.x, step_graph.carry), ca.vertcat(step_graph.x_next, step_graph.carry_next)
    Z, adjoint = ca.SX.sym("Z", n * n), ca.SX.sym("adjoint", state.numel())
    potential = ca.dot(ca.reshape(Z, n, n), sum(step_graph.blocks, ca.SX(n, n))) + ca.dot(adjoint, state_next)
    slopes = ca.gradient(potential, ca.vertcat(state, step_graph.u))
    return Scan(adjoint, [state, step_graph.all_inputs, *step_graph.sampling, Z], slopes[: state.numel()], [slopes[state.numel() :]])
