"""Newton's step on what is active: fast where the convex model, which knows no negative curvature, creeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class ActiveCone:
    """A cone A + sum_i d_i D_i - t_j E + slack >= 0 with its multiplier Z: active along the vectors of Z."""

    A: np.ndarray
    D: np.ndarray
    E: np.ndarray
    epigraph_index: int | None
    Z: np.ndarray


@dataclass(frozen=True, eq=False)
class KKTSystem:
    """minimise g'd + d'H d / 2 - weights't with rows + jacobian d = 0, epigraph_rows + epigraph_jacobian d = t_0.

    On the edges of the active cones, with the entries of d that are at their bounds held there.
    """

    H: np.ndarray
    g: np.ndarray
    weights: np.ndarray
    cones: Sequence[ActiveCone]
    rows: np.ndarray
    jacobian: np.ndarray
    epigraph_rows: np.ndarray
    epigraph_jacobian: np.ndarray
    at_bound: np.ndarray
    d: np.ndarray


def newton_step(system: KKTSystem) -> np.ndarray | None:
    """Return d (q,), or None where the equations have no unique solution."""
    q, T = len(system.g), len(system.weights)
    H, equations, right_side = system.H.copy(), [], []
    for cone in system.cones:
        curvature, jacobian, epigraph_slopes, values = _cone_equations(cone, T)
        H += curvature
        equations.append(np.hstack([jacobian, epigraph_slopes]))
        right_side.append(-values)
    equations.append(np.hstack([system.jacobian, np.zeros((len(system.rows), T))]))
    right_side.append(-system.rows)
    if len(system.epigraph_rows):
        equations.append(np.hstack([system.epigraph_jacobian, -np.ones((len(system.epigraph_rows), T))]))
        right_side.append(-system.epigraph_rows)
    A, b = np.vstack(equations), np.concatenate(right_side)
    fixed = np.where(system.at_bound, system.d, 0.0)
    free = np.append(~system.at_bound, np.ones(T, dtype=bool))
    g = np.concatenate([system.g + H @ fixed, -system.weights])
    b = b - A[:, :q] @ fixed
    hessian = np.zeros((q + T, q + T))
    hessian[:q, :q] = H
    A, free_count = A[:, free], int(free.sum())
    K = np.block([[hessian[np.ix_(free, free)], A.T], [A, np.zeros((len(A), len(A)))]])
    try:
        solution = np.linalg.solve(K, np.concatenate([-g[free], b]))
    except np.linalg.LinAlgError:
        return None
    d = fixed.copy()
    d[~system.at_bound] = solution[: free_count - T]
    return d if np.isfinite(d).all() else None


def _cone_equations(cone: ActiveCone, T: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the curvature (q, q) of the cone's edge, and the equations U'(A + sum d_i D_i - t E) U = 0: slopes to d and t, values.

    The edge bends: 2 tr(Z D S^+ D) with S = A - t E and its eigenvectors apart from U.
    """
    q = len(cone.D)
    values, vectors = np.linalg.eigh(cone.Z)
    U = vectors[:, values > 1e-3 * max(values[-1], 1e-300)]
    t = 0.0 if cone.epigraph_index is None else float(np.sum(cone.Z * cone.A) / max(float(np.sum(cone.Z * cone.E)), 1e-300))
    S = cone.A - t * cone.E
    V = np.linalg.svd(U, full_matrices=True)[0][:, U.shape[1] :]
    curvature = np.zeros((q, q))
    if V.shape[1]:
        R = U.T @ cone.D @ V
        inner = np.linalg.inv(V.T @ S @ V)
        weighted = (U.T @ cone.Z @ U) @ R @ inner
        curvature = 2 * R.reshape(q, -1) @ weighted.reshape(q, -1).T
    rows, columns = np.tril_indices(U.shape[1])
    jacobian = (U.T @ cone.D @ U)[:, rows, columns].T
    epigraph_slopes = np.zeros((len(rows), T))
    if cone.epigraph_index is not None:
        epigraph_slopes[:, cone.epigraph_index] = -(U.T @ cone.E @ U)[rows, columns]
    return curvature, jacobian, epigraph_slopes, (U.T @ cone.A @ U)[rows, columns]
