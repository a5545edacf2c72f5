"""Newton's step on what is active: fast where the convex model, which knows no negative curvature, creeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Face:
    """A cone A + sum_i d_i D_i - t_j E + slack >= 0 with its multiplier Z: active along the vectors of Z."""

    A: np.ndarray
    D: np.ndarray
    E: np.ndarray
    j: int | None
    Z: np.ndarray


@dataclass(frozen=True, eq=False)
class Active:
    """minimise g'd + d'H d / 2 - weights't with rows + slopes d = 0, hard + hard_slopes d = t_0, faces, and d given where held."""

    H: np.ndarray
    g: np.ndarray
    weights: np.ndarray
    faces: Sequence[Face]
    rows: np.ndarray
    slopes: np.ndarray
    hard: np.ndarray
    hard_slopes: np.ndarray
    held: np.ndarray
    d: np.ndarray


def newton(active: Active) -> np.ndarray | None:
    """Return d (q,), or None where the equations have no unique solution."""
    q, T = len(active.g), len(active.weights)
    H, equations, right = active.H.copy(), [], []
    for face in active.faces:
        bent, slopes, along, values = _face(face, T)
        H += bent
        equations.append(np.hstack([slopes, along]))
        right.append(-values)
    equations.append(np.hstack([active.slopes, np.zeros((len(active.rows), T))]))
    right.append(-active.rows)
    if len(active.hard):
        equations.append(np.hstack([active.hard_slopes, -np.ones((len(active.hard), T))]))
        right.append(-active.hard)
    A, b = np.vstack(equations), np.concatenate(right)
    fixed = np.where(active.held, active.d, 0.0)
    free = np.append(~active.held, np.ones(T, dtype=bool))
    g = np.concatenate([active.g + H @ fixed, -active.weights])
    b = b - A[:, :q] @ fixed
    full = np.zeros((q + T, q + T))
    full[:q, :q] = H
    A, size = A[:, free], int(free.sum())
    K = np.block([[full[np.ix_(free, free)], A.T], [A, np.zeros((len(A), len(A)))]])
    try:
        found = np.linalg.solve(K, np.concatenate([-g[free], b]))
    except np.linalg.LinAlgError:
        return None
    d = fixed.copy()
    d[~active.held] = found[: size - T]
    return d if np.isfinite(d).all() else None


def _face(face: Face, T: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the curvature (q, q) of the cone's edge, and the equations U'(A + sum d_i D_i - t E) U = 0: slopes to d and t, values.

    The edge bends: 2 tr(Z D S^+ D) with S = A - t E and its eigenvectors apart from U.
    """
    q = len(face.D)
    values, vectors = np.linalg.eigh(face.Z)
    U = vectors[:, values > 1e-3 * max(values[-1], 1e-300)]
    t = 0.0 if face.j is None else float(np.sum(face.Z * face.A) / max(float(np.sum(face.Z * face.E)), 1e-300))
    S = face.A - t * face.E
    V = np.linalg.svd(U, full_matrices=True)[0][:, U.shape[1] :]
    bent = np.zeros((q, q))
    if V.shape[1]:
        R = U.T @ face.D @ V
        inner = np.linalg.inv(V.T @ S @ V)
        weighed = (U.T @ face.Z @ U) @ R @ inner
        bent = 2 * R.reshape(q, -1) @ weighed.reshape(q, -1).T
    rows, columns = np.tril_indices(U.shape[1])
    slopes = (U.T @ face.D @ U)[:, rows, columns].T
    along = np.zeros((len(rows), T))
    if face.j is not None:
        along[:, face.j] = -(U.T @ face.E @ U)[rows, columns]
    return bent, slopes, along, (U.T @ face.A @ U)[rows, columns]
