"""The convex program of one step: a quadratic model under linear limits and matrix inequalities, solved by Clarabel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import clarabel as _untyped
import numpy as np
from scipy import sparse

clarabel: Any = _untyped  # its stubs leave out what it has
_ACCEPTED_STATUSES = ("Solved", "AlmostSolved")


@dataclass(frozen=True, eq=False)
class Cone:
    """A + sum d_i D_i - t_j E + e slack I >= 0: A (n, n), D (q, n, n), E (n, n); epigraph_index: which t, None = none; slack_factor: e"""

    A: np.ndarray
    D: np.ndarray
    E: np.ndarray
    epigraph_index: int | None
    slack_factor: float


@dataclass(frozen=True, eq=False)
class ConicQP:
    """minimise d'B d / 2 + g'd - weights't + penalty e over low <= d <= high, e >= 0, t free.

    cones; rows + slopes d + e >= 0 (r,), (r, q); hard + hard_slopes d - t_0 >= 0: rows that bound t_0 and have no slack.
    """

    B: np.ndarray
    g: np.ndarray
    weights: np.ndarray
    penalty: float
    lower: np.ndarray
    upper: np.ndarray
    cones: tuple[Cone, ...]
    rows: np.ndarray
    jacobian: np.ndarray
    epigraph_rows: np.ndarray
    epigraph_jacobian: np.ndarray


@dataclass(frozen=True, eq=False)
class ConicSolution:
    """The minimiser: d (q,), e, the multipliers of cones, rows, hard rows and of both bounds."""

    d: np.ndarray
    slack: float
    Z: tuple[np.ndarray, ...]
    row_multipliers: np.ndarray
    epigraph_multipliers: np.ndarray
    bound_multipliers: np.ndarray


def minimise(qp: ConicQP, tolerance: float) -> ConicSolution | None:
    """Return the minimiser, or None where the solver gives up."""
    quick = _solve_clarabel(qp, tolerance, careful=False)
    return quick if quick is not None else _solve_clarabel(qp, tolerance, careful=True)


def _solve_clarabel(qp: ConicQP, tolerance: float, careful: bool) -> ConicSolution | None:
    """Hand the model to Clarabel; careful: with all that it does for badly scaled problems, at twice the time."""
    q, T, slack_column = len(qp.g), len(qp.weights), len(qp.g) + len(qp.weights)
    dense = np.vstack([_linear_rows(qp, slack_column), *(_cone_rows(cone, q, slack_column) for cone in qp.cones)])
    sides = [qp.upper, -qp.lower, [0.0], qp.rows, qp.epigraph_rows, *(_svec(cone.A) for cone in qp.cones)]
    row_count = 2 * q + 1 + len(qp.rows) + len(qp.epigraph_rows)
    cone_types = [clarabel.NonnegativeConeT(row_count), *(clarabel.PSDTriangleConeT(len(cone.A)) for cone in qp.cones)]
    linear = np.concatenate([qp.g, -qp.weights, [qp.penalty]])
    solver = clarabel.DefaultSolver(
        _upper_triangle(qp.B, slack_column + 1),
        linear,
        _constraint_matrix(dense, q, T),
        np.concatenate(sides),
        cone_types,
        _settings(tolerance, careful),
    )
    result = _run_solver(solver)
    if result is None or str(result.status) not in _ACCEPTED_STATUSES:
        return None
    return _unpack_solution(qp, np.array(result.x), np.array(result.z), slack_column)


def _run_solver(solver: Any) -> Any:  # noqa: ANN401
    """Solve, or return None where Clarabel gives up by a panic of Rust, which is no Exception."""
    try:
        return solver.solve()
    except BaseException as error:
        if type(error).__name__ == "PanicException":
            return None
        raise


def _linear_rows(qp: ConicQP, slack_column: int) -> np.ndarray:
    """-slack <= 0, -slopes d - slack <= rows, -hard_slopes d + t_0 <= hard, as rows (., q + T + 1)."""
    q, r, h = len(qp.g), len(qp.rows), len(qp.epigraph_rows)
    matrix = np.zeros((1 + r + h, slack_column + 1))
    matrix[: 1 + r, slack_column] = -1.0
    matrix[1 : 1 + r, :q] = -qp.jacobian
    if h:
        matrix[1 + r :, :q], matrix[1 + r :, q] = -qp.epigraph_jacobian, 1.0
    return matrix


def _cone_rows(cone: Cone, q: int, slack_column: int) -> np.ndarray:
    matrix = np.zeros((cone.A.size - len(cone.A) * (len(cone.A) - 1) // 2, slack_column + 1))
    matrix[:, :q] = -_svec(cone.D).T
    if cone.epigraph_index is not None:
        matrix[:, q + cone.epigraph_index] = _svec(cone.E)
    if cone.slack_factor:
        matrix[:, slack_column] = -cone.slack_factor * _svec(np.eye(len(cone.A)))
    return matrix


def _unpack_solution(qp: ConicQP, x: np.ndarray, z: np.ndarray, slack_column: int) -> ConicSolution:
    q, r, h = len(qp.g), len(qp.rows), len(qp.epigraph_rows)
    cone_start = 2 * q + 1 + r + h
    Z, position = [], cone_start
    for cone in qp.cones:
        n = len(cone.A)
        Z.append(_smat(z[position : position + n * (n + 1) // 2], n))
        position += n * (n + 1) // 2
    rows = z[2 * q + 1 : 2 * q + 1 + r]
    return ConicSolution(x[:q], float(x[slack_column]), tuple(Z), rows, z[cone_start - h : cone_start], np.maximum(z[:q], z[q : 2 * q]))


@lru_cache(8)
def _settings(tolerance: float, careful: bool) -> Any:  # noqa: ANN401
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = 60
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    settings.presolve_enable = settings.chordal_decomposition_enable = careful
    return settings


def _upper_triangle(B: np.ndarray, width: int) -> sparse.csc_matrix:
    """Return the upper triangle of B (q, q), padded with zeros to (width, width)."""
    columns, rows, ends = _triangle_pattern(len(B), width)
    return sparse.csc_matrix((B[rows, columns], rows, ends), shape=(width, width))


@lru_cache(16)
def _triangle_pattern(q: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    columns, rows = np.tril_indices(q)  # of the transpose: column by column
    ends = np.arange(q + 1) * np.arange(1, q + 2) // 2
    return columns, rows, np.concatenate([ends, np.full(width - q, ends[-1])])


def _constraint_matrix(dense: np.ndarray, q: int, T: int) -> sparse.csc_matrix:
    """Return [I 0; -I 0; dense], the bounds of the q first variables above rows without structure."""
    indices, ends = _sparsity_pattern(q, T, len(dense))
    bounds = np.empty((q, 2 + len(dense)))
    bounds[:, 0], bounds[:, 1], bounds[:, 2:] = 1.0, -1.0, dense[:, :q].T
    data = np.concatenate([bounds.ravel(), dense[:, q:].T.ravel()])
    return sparse.csc_matrix((data, indices, ends), shape=(2 * q + len(dense), q + T + 1))


@lru_cache(64)
def _sparsity_pattern(q: int, T: int, row_count: int) -> tuple[np.ndarray, np.ndarray]:
    row_indices = 2 * q + np.arange(row_count)
    first = [np.concatenate([[j, q + j], row_indices]) for j in range(q)]
    ends = np.cumsum([0, *([row_count + 2] * q), *([row_count] * (T + 1))])
    return np.concatenate([*first, *([row_indices] * (T + 1))]), ends


@lru_cache(16)
def _triangle_indices(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    columns, rows = np.tril_indices(n)
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))


def _svec(S: np.ndarray) -> np.ndarray:
    """Upper triangles (..., n (n + 1) / 2) of symmetric S (..., n, n), column by column, off the diagonal times sqrt 2."""
    rows, columns, weights = _triangle_indices(S.shape[-1])
    return S[..., rows, columns] * weights


def _smat(values: np.ndarray, n: int) -> np.ndarray:
    rows, columns, weights = _triangle_indices(n)
    S = np.empty((n, n))
    S[rows, columns] = S[columns, rows] = values / weights
    return S
