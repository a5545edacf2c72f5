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
    try:
        d = _solve(system, *_equations(system))
    except np.linalg.LinAlgError:
        return None
    return d if np.isfinite(d).all() else None


def _equations(system: KKTSystem) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the Hessian (q + T, q + T) to (d, t) with that of the cones' edges, and A, b of what is active: b + A (d, t - levels) = 0."""
    q, T = len(system.g), len(system.weights)
    levels = _levels(system.cones, T)
    hessian, rows, values = np.zeros((q + T, q + T)), [], []
    hessian[:q, :q] = system.H
    for cone in system.cones:
        curvature, slopes, edge_values = _cone_equations(cone, levels)
        hessian += curvature
        rows.append(slopes)
        values.append(edge_values)
    limits, epigraphs = len(system.rows), len(system.epigraph_rows)
    plain = np.zeros((limits + epigraphs, q + T))
    plain[:limits, :q], plain[limits:, :q] = system.jacobian, system.epigraph_jacobian
    plain[limits:, q:] = -1.0
    b = np.concatenate([*values, system.rows, system.epigraph_rows - levels[:1].sum()])
    return hessian, np.vstack([*rows, plain]), b


def _solve(system: KKTSystem, hessian: np.ndarray, A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return d (q,): what is at its bound stays there."""
    T = len(system.weights)
    d = np.where(system.at_bound, system.d, 0.0)
    fixed, free = np.append(d, np.zeros(T)), np.flatnonzero(np.append(~system.at_bound, np.ones(T, dtype=bool)))
    g = np.append(system.g, -system.weights) + hessian @ fixed
    count, size = len(free), len(free) + len(A)
    K, right_side = np.zeros((size, size)), np.empty(size)
    K[:count, :count], K[count:, :count] = hessian[np.ix_(free, free)], A[:, free]
    K[:count, count:] = K[count:, :count].T
    right_side[:count], right_side[count:] = -g[free], -b - A @ fixed
    d[~system.at_bound] = np.linalg.solve(K, right_side)[: count - T]
    return d


def _levels(cones: Sequence[ActiveCone], T: int) -> np.ndarray:
    """Return what each t (T,) is at d = 0 by the multipliers: <Z, A> / <Z, E>, of all cones that bound it."""
    values, weights = np.zeros(T), np.zeros(T)
    for cone in cones:
        if cone.epigraph_index is not None:
            values[cone.epigraph_index] += np.sum(cone.Z * cone.A)
            weights[cone.epigraph_index] += np.sum(cone.Z * cone.E)
    return values / np.where(weights > 0, weights, 1.0)


def _cone_equations(cone: ActiveCone, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return curvature (q + T, q + T), slopes (., q + T) and values of the equations of a cone's edge.

    With x = (d, t - levels) and M = A - levels E + sum x_i D_i, D_i = -E of a t, the matrix has as many zeros as U has columns where

        U'M U - U'M V (V'M V)^-1 V'M U = 0,   V the vectors apart from U (Schur complement)

    here to second order in x, U'M V being small: the vectors are those of where the model's solution leads to, not of x = 0.
    """
    D = _slopes(cone, len(levels))
    values, vectors = np.linalg.eigh(cone.Z)
    is_active = values > 1e-3 * max(values[-1], 1e-300)
    U, V = vectors[:, is_active], vectors[:, ~is_active]
    S = cone.A if cone.epigraph_index is None else cone.A - levels[cone.epigraph_index] * cone.E
    inside = _in_basis(D, np.hstack([U, V]))
    k = U.shape[1]
    edge_values, edge_slopes, curvature = U.T @ S @ U, inside[:, :k, :k], np.zeros((len(D), len(D)))
    if V.shape[1]:
        R, cross, inner = inside[:, :k, k:], U.T @ S @ V, np.linalg.inv(V.T @ S @ V)
        bent = R @ (inner @ cross.T)
        edge_values, edge_slopes = edge_values - cross @ inner @ cross.T, edge_slopes - bent - bent.swapaxes(1, 2)
        weighted = (U.T @ cone.Z @ U) @ R @ inner
        curvature = 2 * R.reshape(len(D), -1) @ weighted.reshape(len(D), -1).T
    rows, columns = np.tril_indices(U.shape[1])
    return curvature, edge_slopes[:, rows, columns].T, edge_values[rows, columns]


def _in_basis(D: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return Q'D Q of symmetric D (q, n, n)."""
    q, n, _ = D.shape
    half = (D.reshape(q * n, n) @ Q).reshape(q, n, n)
    return (half.swapaxes(1, 2).reshape(q * n, n) @ Q).reshape(q, n, n)


def _slopes(cone: ActiveCone, T: int) -> np.ndarray:
    """Return the cone's slopes (q + T, n, n) to d and t."""
    D = np.zeros((len(cone.D) + T, *cone.E.shape))
    D[: len(cone.D)] = cone.D
    if cone.epigraph_index is not None:
        D[len(cone.D) + cone.epigraph_index] = -cone.E
    return D
