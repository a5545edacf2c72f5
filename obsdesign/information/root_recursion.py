"""Roots of what is known along a path: in doubles, and with more digits where these would claim their own rounding."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.dynamics.driven_step import driven_step
from obsdesign.dynamics.model import AbstractSystem, Model
from obsdesign.dynamics.nuisance_states import NuisanceStates, nuisance_of
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.simulation import all_inputs_along, substeps_along
from obsdesign.dynamics.step import CACHE_SIZE
from obsdesign.information.backward_pass import raise_not_finite, rows_of_samples
from obsdesign.information.information_update import Disturbance, InformationRoot, predict
from obsdesign.information.linearisation import linearise
from obsdesign.information.nuisance_information import ErrorDistribution, predict_with_errors, update_with_samples
from obsdesign.packing import pack, pack_values, symmetric
from obsdesign.prior import Prior
from obsdesign.round_off import rotated_triangles
from obsdesign.trajectory import Trajectory

_TRUSTED_ERROR = 1e-10  # share of a column of a root that its rounding may have
_NEGLIGIBLE = 1e-9  # share of the prior's column below which a column says nothing


def initial_carry_of(prior: Prior, nuisance: NuisanceStates, error_rows: int) -> np.ndarray:
    """Return the carry before the samples of t_0: (T, rounding, error) about (b, x), M = 0 and V = R, column by column."""
    root = np.linalg.inv(np.linalg.cholesky(prior.covariance))
    a, c = len(nuisance.coloured), len(nuisance.constant)
    T = np.eye(c + len(root))
    T[c:, c:] = root
    rounding, error = np.finfo(float).eps * np.abs(T).sum(axis=0), np.zeros(error_rows * len(T))
    return np.concatenate([T.ravel(order="F"), rounding, error, np.zeros(a * len(T)), pack_values(nuisance.R)])


def error_rows_of(disturbance: Disturbance) -> int:
    """How many rows of errors are carried beside T: where something moves the state, what is left may be rounding of what that took."""
    return int(bool(disturbance.unknown or disturbance.noise.is_any))


@lru_cache(CACHE_SIZE)
def forward_scan(model: Model, step: float, disturbance: Disturbance, substeps: int, with_errors: bool = False) -> Scan:
    """Carry before the samples of t_k, rows x_k, (u, w)_k, active (S,) -> carry before those of t_k+1; results: R after those of t_k.

    The carry is (T, rounding, error): T'T the information, T and R column by column; see `InformationRoot`. The error of R is a result
    as well. With errors that last, T is about the constant ones and the state, and M and V of the others follow; see
    `ErrorDistribution`. with_errors: R, M and V are the results.
    """
    driven, nuisance = driven_step(model, step, substeps, disturbance.noise), nuisance_of(model, step)
    step_graph, B = driven.step, driven.step.B_w[:, list(disturbance.unknown)]
    a, c, n = len(nuisance.coloured), len(nuisance.constant), len(model.states)
    error_rows = error_rows_of(disturbance)
    root = InformationRoot(ca.SX.sym("T", c + n, c + n), ca.SX.sym("rounding", c + n), ca.SX.sym("error", error_rows, c + n))
    weights, unit = ca.SX.sym("active", len(model.channels)), ca.SX.sym("unit", n)
    M, (V, entries) = ca.SX.sym("M", a, c + n), symmetric("V", a)
    errors = ErrorDistribution(M, V)
    carry = ca.vertcat(_carry_of(root), ca.vec(M), entries)
    if nuisance.size:
        rows, counts, errors = update_with_samples(model, nuisance, errors, weights)
        updated = root.with_rows(ca.sqrt(counts) * rows)
        predicted, next_errors = predict_with_errors(updated, errors.predict(nuisance, driven.model), step_graph.F, B, driven.noise, unit)
    else:
        updated, next_errors = root.with_rows(rows_of_samples(model, weights)), errors
        predicted = predict(updated, step_graph.F, B, driven.noise, unit)
    carry_next = ca.vertcat(_carry_of(predicted), ca.vec(next_errors.M), pack(next_errors.V))
    results = [updated.T, errors.M, errors.V] if with_errors else [updated.T[c:, c:], updated.error_about_last(n)]
    columns = [ca.vec(ca.densify(result)) for result in results]
    return Scan(carry, [step_graph.x, step_graph.all_inputs, weights, unit], carry_next, columns, loop=step_graph.loop)


def _carry_of(root: InformationRoot) -> ca.SX:
    return ca.vertcat(ca.vec(ca.densify(root.T)), root.rounding, ca.vec(ca.densify(root.error)))


def posterior_roots(system: AbstractSystem, path: Trajectory, prior: Prior, disturbance: Disturbance, weights: np.ndarray) -> np.ndarray:
    """Return R (N+1, n, n): R'R is what is known of x(t_k) after its samples, at t_N before them.

    In doubles; anew with as many digits as it takes where that would claim what is rounding.
    """
    n, nuisance = path.x.shape[1], nuisance_of(system.model, path.pace)
    size, error_rows = n + len(nuisance.constant), error_rows_of(disturbance)
    rows = [path.x[:-1], all_inputs_along(system, path), weights, prior.std]
    scan = forward_scan(system.model, path.pace, disturbance, substeps_along(system, path))
    run = scan.run(initial_carry_of(prior, nuisance, error_rows)[None], rows, path.steps, carries=False)
    columns = run.carry[0, : size * (size + 1 + error_rows)].reshape(-1, size).T
    last, last_error = _about_state(columns[:, :size], columns[:, size + 1 :].T, n)
    roots = np.concatenate([run.results[0][0].reshape(-1, n, n).swapaxes(1, 2), last[None]])
    if not np.isfinite(roots).all():
        raise_not_finite(roots, system, path, weights)
    if error_rows and _is_rounding_claimed(roots, np.concatenate([run.results[1][0], last_error]), prior.std):
        return _roots_in_long_numbers(system, path, prior, disturbance, weights)
    return roots


def _is_rounding_claimed(roots: np.ndarray, errors: np.ndarray, deviations: np.ndarray) -> bool:
    """Return whether what roots (N, n, n) claim of some state may be rounding, from their errors (N, n) and prior deviations (n,).

    Less than 1e-18 of the prior's information is nothing.
    """
    with np.errstate(over="ignore"):
        sizes = np.sqrt(np.einsum("kij,kij->kj", roots, roots))
    return bool(((np.abs(errors) > _TRUSTED_ERROR * sizes) & (sizes * deviations > _NEGLIGIBLE)).any())


def _roots_in_long_numbers(
    system: AbstractSystem, path: Trajectory, prior: Prior, disturbance: Disturbance, weights: np.ndarray
) -> np.ndarray:
    """Return the same R, from numbers of as many bits as it takes."""
    from obsdesign.information.long_recursion import LinearProblem, long_roots  # flint is seldom needed

    model = system.model
    counts = weights[:, list(model.output_owner)]
    problem = LinearProblem(
        linearise(system, path, weights, disturbance.noise),
        nuisance_of(model, path.pace),
        path.paces,
        counts,
        prior.covariance,
        disturbance.unknown,
    )
    roots = long_roots(problem)
    if not np.isfinite(roots).all():
        raise_not_finite(roots, system, path, weights)
    return roots


def _about_state(T: np.ndarray, error: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the root (n, n), and its error (r, n), of what T says about the last n, whatever the others are."""
    c = len(T) - n
    if not c or not np.isfinite(T).all():
        return T[:, c:], error[:, c:]
    R = rotated_triangles(T)
    return R[c:, c:], error[:, c:] - np.linalg.solve(R[:c, :c].T, error[:, :c].T).T @ R[:c, c:]
