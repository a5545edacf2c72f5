"""Update and prediction of a filter whose samples have errors that last: those are states too, and covariances are carried as roots.

S S' = P of X = (x, z, b): with nothing white in a sample, P is singular after it, and what a root loses to rounding is a share of a
standard deviation, where a covariance loses one of a variance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.nuisance_states import NuisanceStates, nuisance_of
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.step import CACHE_SIZE, Step, looped_step
from obsdesign.information.householder import triangular_factor


@dataclass(frozen=True, eq=False)
class FilterScans:
    """The walks of a filter: a prediction, an update, and one after the other with mean and covariance of x between them."""

    predict: Scan
    update: Scan
    update_predict: Scan


def root_of(covariance: np.ndarray) -> np.ndarray:
    """Return S (..., n, n), S S' = covariance, positive semidefinite, each state in its own unit."""
    size = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    unit = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / (unit[..., :, None] * unit[..., None, :]))
    return unit[..., :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]


def root_start(mean: np.ndarray, covariance: np.ndarray, nuisance: NuisanceStates) -> np.ndarray:
    """Return the carry (R, .) of beliefs about x, mean (R, n) and covariance (R, n, n), before the first sample."""
    (runs, n), a = mean.shape, len(nuisance.coloured)
    S = np.zeros((runs, n + nuisance.size, n + nuisance.size))
    S[:, :n, :n] = root_of(covariance)
    S[:, n : n + a, n : n + a] = root_of(nuisance.R)
    S[:, n + a :, n + a :] = np.eye(len(nuisance.constant))
    return np.hstack([mean, np.zeros((runs, nuisance.size)), S.swapaxes(1, 2).reshape(runs, -1)])


def root_belief(carry: np.ndarray, n: int, nuisance: NuisanceStates) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (R, n) and covariance (R, n, n) of x."""
    size = n + nuisance.size
    S = carry[:, size:].reshape(-1, size, size).swapaxes(1, 2)[:, :n]
    return carry[:, :n], S @ S.swapaxes(1, 2)


@lru_cache(CACHE_SIZE)
def root_scans(model: Model, step: float, substeps: int) -> FilterScans:
    """Return the walks; the carry is (X, S), S column by column, and the row of process noise a root (n n,) of it by rows."""
    n, nuisance = model.x.numel(), nuisance_of(model, step)
    size = n + nuisance.size
    X, S, u = ca.vertcat(model.x, ca.SX.sym("errors", size - n)), ca.SX.sym("S", size, size), model.u
    carry, noise = ca.vertcat(X, ca.vec(S)), ca.SX.sym("noise", n * n)
    y, active = (ca.SX.sym(name, len(model.outputs)) for name in ("y", "active"))
    mean, root = _update(model, step, (X, S), y, active)
    step_graph = looped_step(model, step, substeps).without_disturbance()
    updated_step = step_graph.starting_at(mean[:n])
    x_moments = [mean[:n], ca.vec(root[:n, :] @ root[:n, :].T)]
    return FilterScans(
        Scan(carry, [u, noise], _predict(step_graph, nuisance, X, S, noise), loop=step_graph.loop),
        Scan(carry, [y, active], ca.vertcat(mean, ca.vec(root))),
        Scan(carry, [u, y, active, noise], _predict(updated_step, nuisance, mean, root, noise), x_moments, loop=updated_step.loop),
    )


def _predict(step_graph: Step, nuisance: NuisanceStates, X: ca.SX, S: ca.SX, noise: ca.SX) -> ca.SX:
    """(f(x, u), decay z, b) and the triangular root of F S S' F' + Q, F and Q those of (x, z, b); the step starts at the x of X."""
    x_next, F, n = step_graph.x_next, step_graph.F, step_graph.x.numel()
    decay = ca.SX(ca.DM(nuisance.transition))
    driving_root = ca.sparsify(ca.SX(ca.DM(root_of(nuisance.driving_covariance))))
    propagated = ca.diagcat(F, ca.diag(decay)) @ S
    noise_columns = ca.diagcat(ca.reshape(noise, n, n).T, driving_root, ca.SX(len(nuisance.constant), 0))
    root = triangular_factor(ca.horzcat(propagated, noise_columns).T).T
    return ca.vertcat(x_next, decay * X[n:], ca.vec(ca.densify(root)))


def _update(model: Model, step: float, belief: tuple[ca.SX, ca.SX], y: ca.SX, active: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Mean and root after the active outputs, one by one, all linearised at the predicted mean.

    f = S'C', v = f'f + R, S+ = S - S f f' / (v + (R v)^1/2); R is the variance of what is white in a sample.
    Source: Potter (1963), in Bierman (1977), section II.7.
    """
    X, S = belief
    C, expected, R = _outputs(model, step, X)
    correction = ca.SX.zeros(X.numel())
    for i, signal in enumerate(model.outputs):
        # an output that is off must not matter, not even where it has no derivative
        row = ca.if_else(active[i], C[i, :], ca.SX(1, X.numel()))
        residual = ca.if_else(active[i], y[i] - expected[i], 0)
        if signal.is_angle:
            residual = ca.remainder(residual, 2 * np.pi)
        white_variance = ca.if_else(active[i], R[i], 1)
        f = S.T @ row.T
        v, innovation_column = ca.sumsqr(f) + white_variance, S @ f
        correction += innovation_column / v * (residual - row @ correction)
        S = S - innovation_column @ f.T / (v + ca.sqrt(white_variance * v))
    return X + correction, S


def _outputs(model: Model, step: float, X: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """What is expected of each output (q, 1), its derivative to X (q, n + e), and the variance of what is white in it (q, 1)."""
    nuisance, n = nuisance_of(model, step), model.x.numel()
    R, loads = ca.diag(model.instant_covariance), ca.SX(len(model.outputs), nuisance.size)
    for index, i in enumerate(nuisance.coloured):
        loads[i, index] = ca.sqrt(R[i])
        R[i] = 0
    for index, i in enumerate(nuisance.constant):
        loads[i, len(nuisance.coloured) + index] = nuisance.bias[index]
    return ca.horzcat(ca.jacobian(model.h, model.x), loads), model.h + loads @ X[n:], R
