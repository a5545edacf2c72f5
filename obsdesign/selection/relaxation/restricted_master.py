"""The best mixture of a few schedules, and the prices that say what would improve it."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from obsdesign.conic import nonnegative_cone, semidefinite_cone, smat, solve_conic_program, svec, zero_cone
from obsdesign.selection.dual import Dual
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column import Column, Mixture
from obsdesign.selection.relaxation.master_newton import MASTER_SETTINGS, maximise_by_newton


def solve_master(instance: SelectionProblem, columns: list[Column], previous: Mixture | None) -> Mixture | None:
    """Return the best mixture, or None where the solver gives up. previous: that of the first columns, where a climb begins."""
    if instance.criterion.is_smallest_eigenvalue:
        return _maximise_eigenvalue(instance, columns)
    return maximise_by_newton(instance, columns, previous)


def _maximise_eigenvalue(instance: SelectionProblem, columns: list[Column]) -> Mixture | None:
    """max t - penalty'a over known + V_r(a) - t diag(metric) >= 0, usage'a <= limits, sum a = 1, a >= 0.

    Solved with unit diagonals of all columns together and t in units of 1 / max metric: the same problem, well conditioned. The columns
    contain what is known, so it is in every mixture.
    """
    J, R, n, m = len(columns), len(instance.working_sensors), instance.n, len(instance.resources)
    W = np.stack([column.W for column in columns])
    D = _column_scaling(W)
    unit, metric = _metric_in_units(instance, D)
    scaled = W * np.outer(D, D)
    cone = np.vstack([np.hstack([-svec(scaled[:, r]).T, svec(np.diag(metric))[:, None]]) for r in range(R)])
    usage = np.stack([column.usage for column in columns]).T if m else np.zeros((0, J))
    scale = np.maximum(instance.limits, 1e-9 + np.abs(usage).max(axis=1, initial=0.0)) if m else np.zeros(0)
    rows = np.vstack([np.hstack([np.ones((1, J)), np.zeros((1, 1))]), np.hstack([-np.eye(J), np.zeros((J, 1))])])
    rows = np.vstack([rows, np.hstack([usage / scale[:, None], np.zeros((m, 1))]), cone])
    right_hand_side = np.concatenate([[1.0], np.zeros(J), instance.limits / scale, np.zeros(len(cone))])
    objective = np.append([column.penalty / unit for column in columns], -1.0)
    cones = [zero_cone(1), nonnegative_cone(J + m), *(semidefinite_cone(n) for _ in range(R))]
    solution = solve_conic_program(
        sparse.csc_matrix((J + 1, J + 1)), objective, sparse.csc_matrix(rows), right_hand_side, cones, MASTER_SETTINGS
    )
    if solution is None:
        return None
    x, z = solution
    size_of_Z = n * (n + 1) // 2
    Z = np.stack([smat(z[1 + J + m + r * size_of_Z :][:size_of_Z], n) for r in range(R)])
    Z = normalise_dual(Z, metric) * np.outer(D, D) * unit
    mu = np.maximum(z[1 + J : 1 + J + m], 0.0) / scale * unit if m else np.zeros(0)
    shares = np.maximum(x[:J], 0.0)
    shares /= shares.sum()
    value = instance.mixture_value(np.tensordot(shares, W, 1)) - shares @ [column.penalty for column in columns]
    return Mixture(shares, float(value), Dual(Z, mu, 0.0), np.ones(R) / R)


def _column_scaling(W: np.ndarray) -> np.ndarray:
    total = np.diagonal(W.sum(axis=(0, 1)))
    return 1 / np.sqrt(np.where(total > 0, total, 1.0)) * np.sqrt(len(W) * W.shape[1])


def _metric_in_units(instance: SelectionProblem, D: np.ndarray) -> tuple[float, np.ndarray]:
    """The unit of t, and what of each state counts in it (n,): at most 1 in units D."""
    metric = instance.scaled_criterion.metric * D**2
    return 1 / float(metric.max()), metric / metric.max()


def normalise_dual(Z: np.ndarray, metric: np.ndarray) -> np.ndarray:
    """The nearest Z_r >= 0 with sum <diag(metric), Z_r> = 1: what makes a bound of it whatever the solver returned."""
    values, eigenvectors = np.linalg.eigh((Z + Z.swapaxes(1, 2)) / 2)
    positive = (eigenvectors * np.maximum(values, 0.0)[:, None, :]) @ eigenvectors.swapaxes(1, 2)
    total = float(np.sum(np.diagonal(positive, axis1=1, axis2=2) * metric))
    if not total > 0:
        positive = np.broadcast_to(np.diag((metric > 0).astype(float)), Z.shape)
        total = len(Z) * float(metric.sum())
    return positive / total
