"""What of the Lagrangian's Hessian a convex model may keep: negative curvature only along what is active."""

from __future__ import annotations

import numpy as np

from obsdesign.design.sqp.evaluation import AbstractDerivatives, Multipliers
from obsdesign.design.sqp.matrix_objective import AbstractMatrixObjective

ACTIVE_MULTIPLIER = 1e-6  # multipliers above this are of something active
_NORMAL_WEIGHT = 10.0  # weight of active normals in what is made convex, in units of the largest curvature
_NEGATIVE_SHARE = 1e-6  # share of the largest curvature below which one is not negative


def active_normals(
    objective: AbstractMatrixObjective, derivatives: AbstractDerivatives, multipliers: Multipliers, at_bound: np.ndarray, width: np.ndarray
) -> np.ndarray:
    """Return directions (k, q), in widths of the box, along which a step is settled by what is active: there H need not be convex."""
    normals = [derivatives.rows[multipliers.rows > ACTIVE_MULTIPLIER] * width, np.eye(len(width))[at_bound]]
    if objective.is_cone:
        active = np.trace(multipliers.matrices, axis1=1, axis2=2) > ACTIVE_MULTIPLIER * multipliers.price  # the others are rounding
        pairs = zip(multipliers.matrices[active], derivatives.matrices[active], strict=True)
        normals += [_eigenvalue_difference_slopes(Z, D) * width for Z, D in pairs]
    return np.vstack(normals)


def _eigenvalue_difference_slopes(Z: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Return the slopes (k, q) of the differences that stay 0 where eigenvalues coincide, their vectors being those of Z."""
    values, vectors = np.linalg.eigh(Z)
    U = vectors[:, values > 1e-3 * max(values[-1], np.finfo(float).tiny)]
    k = U.shape[1]
    if k < 2:
        return np.zeros((0, len(D)))
    R = (D.reshape(-1, len(Z)) @ U).reshape(*D.shape[:2], k).swapaxes(1, 2) @ U
    upper = np.triu_indices(k, 1)
    return np.vstack([R[:, upper[0], upper[1]].T, (R[:, np.arange(1, k), np.arange(1, k)] - R[:, :1, 0]).T])


def convexify(H: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Return H without the negative curvature that is not along the normals (k, q), and the direction (q,) of most of that, if any."""
    size = float(np.abs(H).max(initial=0.0))
    if not size > 0:
        return 1e-8 * np.eye(len(H)), None
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    unit_normals = normals / np.where(lengths > 0, lengths, 1.0)
    values, vectors = np.linalg.eigh(H + _NORMAL_WEIGHT * size * unit_normals.T @ unit_normals)
    negative_curvature = vectors[:, 0] if values[0] < -_NEGATIVE_SHARE * size else None
    return (vectors * np.maximum(values, 1e-7 * size)) @ vectors.T, negative_curvature
