"""The convex program of one step: a quadratic model under linear limits and matrix inequalities, solved by Clarabel."""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
from scipy import sparse

_ACCEPTED = ("Solved", "AlmostSolved")


@dataclass(frozen=True, eq=False)
class Cone:
    """A + sum_i d_i D_i - t_j E + e share I >= 0: A (n, n), D (q, n, n), E (n, n); j: which t, None = none; share: of the slack."""

    A: np.ndarray
    D: np.ndarray
    E: np.ndarray
    j: int | None
    share: float


@dataclass(frozen=True, eq=False)
class Model:
    """minimise d'B d / 2 + g'd - weights't + penalty e over low <= d <= high, e >= 0, t free.

    cones; rows + slopes d + e >= 0 (r,), (r, q); hard + hard_slopes d - t_0 >= 0: rows that bound t_0 and have no slack.
    """

    B: np.ndarray
    g: np.ndarray
    weights: np.ndarray
    penalty: float
    low: np.ndarray
    high: np.ndarray
    cones: tuple[Cone, ...]
    rows: np.ndarray
    slopes: np.ndarray
    hard: np.ndarray
    hard_slopes: np.ndarray


@dataclass(frozen=True, eq=False)
class Step:
    """The minimiser: d (q,), e, the multipliers of cones, rows, hard rows and of both bounds."""

    d: np.ndarray
    e: float
    Z: tuple[np.ndarray, ...]
    rows: np.ndarray
    hard: np.ndarray
    bounds: np.ndarray


def minimised(model: Model, tolerance: float) -> Step | None:
    """Return the minimiser, or None where the solver gives up."""
    q, T, r, h = len(model.g), len(model.weights), len(model.rows), len(model.hard)
    width = q + T + 1
    slack = q + T
    linear = np.concatenate([model.g, -model.weights, [model.penalty]])
    A = np.zeros((2 * q + 1 + r + h, width))
    b = np.concatenate([model.high, -model.low, [0.0], model.rows, model.hard])
    at = np.arange(q)
    A[at, at], A[q + at, at], A[2 * q, slack] = 1.0, -1.0, -1.0
    A[2 * q + 1 : 2 * q + 1 + r, :q], A[2 * q + 1 : 2 * q + 1 + r, slack] = -model.slopes, -1.0
    if h:
        A[2 * q + 1 + r :, :q], A[2 * q + 1 + r :, q] = -model.hard_slopes, 1.0
    parts, sides, kinds = [A], [b], [clarabel.NonnegativeConeT(len(A))]
    for cone in model.cones:
        n = len(cone.A)
        part = np.zeros((n * (n + 1) // 2, width))
        part[:, :q] = -_vector(cone.D).T
        if cone.j is not None:
            part[:, q + cone.j] = _vector(cone.E)
        part[:, slack] = -cone.share * _vector(np.eye(n))
        parts.append(part)
        sides.append(_vector(cone.A))
        kinds.append(clarabel.PSDTriangleConeT(n))
    solver = clarabel.DefaultSolver(
        _upper(model.B, width), linear, sparse.csc_matrix(np.vstack(parts)), np.concatenate(sides), kinds, _settings(tolerance)
    )
    found = solver.solve()
    if str(found.status) not in _ACCEPTED:
        return None
    x, z = np.array(found.x), np.array(found.z)
    Z, first = [], len(A)
    for cone in model.cones:
        n = len(cone.A)
        Z.append(_matrix(z[first : first + n * (n + 1) // 2], n))
        first += n * (n + 1) // 2
    rows = z[2 * q + 1 : 2 * q + 1 + r]
    return Step(x[:q], float(x[slack]), tuple(Z), rows, z[2 * q + 1 + r : len(A)], np.maximum(z[:q], z[q : 2 * q]))


def _settings(tolerance: float) -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = 60
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    return settings


def _upper(B: np.ndarray, width: int) -> sparse.csc_matrix:
    """Return the upper triangle of B (q, q), padded with zeros to (width, width)."""
    q = len(B)
    ends = np.arange(q + 1) * np.arange(1, q + 2) // 2
    columns, rows = np.tril_indices(q)  # of the transpose: column by column
    return sparse.csc_matrix((B[rows, columns], rows, np.concatenate([ends, np.full(width - q, ends[-1])])), shape=(width, width))


def _vector(S: np.ndarray) -> np.ndarray:
    """Upper triangles (..., n (n + 1) / 2) of symmetric S (..., n, n), column by column, off the diagonal times sqrt 2."""
    columns, rows = np.tril_indices(S.shape[-1])
    return S[..., rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2.0))


def _matrix(values: np.ndarray, n: int) -> np.ndarray:
    columns, rows = np.tril_indices(n)
    S = np.empty((n, n))
    S[rows, columns] = S[columns, rows] = values / np.where(rows == columns, 1.0, np.sqrt(2.0))
    return S
