"""The convex program of one step: a quadratic model under linear limits and matrix inequalities, solved by Clarabel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import clarabel as _untyped
import numpy as np
from scipy import sparse

clarabel: Any = _untyped  # its stubs leave out what it has
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
    quick = _solved(model, tolerance, careful=False)
    return quick if quick is not None else _solved(model, tolerance, careful=True)


def _solved(model: Model, tolerance: float, careful: bool) -> Step | None:
    """Hand the model to Clarabel; careful: with all that it does for badly scaled problems, at twice the time."""
    q, T, slack = len(model.g), len(model.weights), len(model.g) + len(model.weights)
    dense = np.vstack([_rows(model, slack), *(_cone_rows(cone, q, slack) for cone in model.cones)])
    sides = [model.high, -model.low, [0.0], model.rows, model.hard, *(_vector(cone.A) for cone in model.cones)]
    lines = 2 * q + 1 + len(model.rows) + len(model.hard)
    kinds = [clarabel.NonnegativeConeT(lines), *(clarabel.PSDTriangleConeT(len(cone.A)) for cone in model.cones)]
    linear = np.concatenate([model.g, -model.weights, [model.penalty]])
    solver = clarabel.DefaultSolver(
        _upper(model.B, slack + 1), linear, _stacked(dense, q, T), np.concatenate(sides), kinds, _settings(tolerance, careful)
    )
    found = _run(solver)
    if found is None or str(found.status) not in _ACCEPTED:
        return None
    return _step(model, np.array(found.x), np.array(found.z), slack)


def _run(solver: Any) -> Any:  # noqa: ANN401
    """Solve, or return None where Clarabel gives up by a panic of Rust, which is no Exception."""
    try:
        return solver.solve()
    except BaseException as error:
        if type(error).__name__ == "PanicException":
            return None
        raise


def _rows(model: Model, slack: int) -> np.ndarray:
    """-slack <= 0, -slopes d - slack <= rows, -hard_slopes d + t_0 <= hard, as rows (., q + T + 1)."""
    q, r, h = len(model.g), len(model.rows), len(model.hard)
    found = np.zeros((1 + r + h, slack + 1))
    found[: 1 + r, slack] = -1.0
    found[1 : 1 + r, :q] = -model.slopes
    if h:
        found[1 + r :, :q], found[1 + r :, q] = -model.hard_slopes, 1.0
    return found


def _cone_rows(cone: Cone, q: int, slack: int) -> np.ndarray:
    found = np.zeros((cone.A.size - len(cone.A) * (len(cone.A) - 1) // 2, slack + 1))
    found[:, :q] = -_vector(cone.D).T
    if cone.j is not None:
        found[:, q + cone.j] = _vector(cone.E)
    if cone.share:
        found[:, slack] = -cone.share * _vector(np.eye(len(cone.A)))
    return found


def _step(model: Model, x: np.ndarray, z: np.ndarray, slack: int) -> Step:
    q, r, h = len(model.g), len(model.rows), len(model.hard)
    first = 2 * q + 1 + r + h
    Z, at = [], first
    for cone in model.cones:
        n = len(cone.A)
        Z.append(_matrix(z[at : at + n * (n + 1) // 2], n))
        at += n * (n + 1) // 2
    rows = z[2 * q + 1 : 2 * q + 1 + r]
    return Step(x[:q], float(x[slack]), tuple(Z), rows, z[first - h : first], np.maximum(z[:q], z[q : 2 * q]))


@lru_cache(8)
def _settings(tolerance: float, careful: bool) -> Any:  # noqa: ANN401
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = 60
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    settings.presolve_enable = settings.chordal_decomposition_enable = careful
    return settings


def _upper(B: np.ndarray, width: int) -> sparse.csc_matrix:
    """Return the upper triangle of B (q, q), padded with zeros to (width, width)."""
    columns, rows, ends = _triangle(len(B), width)
    return sparse.csc_matrix((B[rows, columns], rows, ends), shape=(width, width))


@lru_cache(16)
def _triangle(q: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    columns, rows = np.tril_indices(q)  # of the transpose: column by column
    ends = np.arange(q + 1) * np.arange(1, q + 2) // 2
    return columns, rows, np.concatenate([ends, np.full(width - q, ends[-1])])


def _stacked(dense: np.ndarray, q: int, T: int) -> sparse.csc_matrix:
    """Return [I 0; -I 0; dense], the bounds of the q first variables above rows without structure."""
    indices, ends = _places(q, T, len(dense))
    bounds = np.empty((q, 2 + len(dense)))
    bounds[:, 0], bounds[:, 1], bounds[:, 2:] = 1.0, -1.0, dense[:, :q].T
    data = np.concatenate([bounds.ravel(), dense[:, q:].T.ravel()])
    return sparse.csc_matrix((data, indices, ends), shape=(2 * q + len(dense), q + T + 1))


@lru_cache(64)
def _places(q: int, T: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
    below = 2 * q + np.arange(lines)
    first = [np.concatenate([[j, q + j], below]) for j in range(q)]
    ends = np.cumsum([0, *([lines + 2] * q), *([lines] * (T + 1))])
    return np.concatenate([*first, *([below] * (T + 1))]), ends


@lru_cache(16)
def _lower(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    columns, rows = np.tril_indices(n)
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))


def _vector(S: np.ndarray) -> np.ndarray:
    """Upper triangles (..., n (n + 1) / 2) of symmetric S (..., n, n), column by column, off the diagonal times sqrt 2."""
    rows, columns, weights = _lower(S.shape[-1])
    return S[..., rows, columns] * weights


def _matrix(values: np.ndarray, n: int) -> np.ndarray:
    rows, columns, weights = _lower(n)
    S = np.empty((n, n))
    S[rows, columns] = S[columns, rows] = values / weights
    return S
