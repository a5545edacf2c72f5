"""The convex program of one step, solved by compiled code for dense data, or by Clarabel."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy import sparse

from obsdesign.conic import ConicSettings, nonnegative_cone, semidefinite_cone, smat, solve_conic_program, svec, upper_triangle
from obsdesign.design.sqp.conic_model import Cone, ConicQP, ConicSolution
from obsdesign.design.sqp.dense_qp import minimise_densely

_MAX_ITERATIONS = 60  # of Clarabel: models take 10 to 20, those that are badly scaled more
_ATTEMPTS = (
    ConicSettings(0.0, _MAX_ITERATIONS, with_presolve=False),
    ConicSettings(0.0, _MAX_ITERATIONS),
    ConicSettings(0.0, _MAX_ITERATIONS, with_equilibration=False),
)


def minimise(qp: ConicQP, tolerance: float) -> ConicSolution | None:
    """Return the minimiser to a tolerance, or None where the solvers give up.

    By `minimise_densely`; where there is no machine code, or it does not come that near, by Clarabel: first without what Clarabel does
    for badly scaled problems, which takes half of its time; with it where that fails; and without any scaling where that fails too:
    with many cones beside bounds that are next to 0 it is the scaling that stops Clarabel at once. Where numbers are many decades apart
    Clarabel calls solved what is not: its answer is a claim, whose value has to be recomputed.
    """
    solution = minimise_densely(qp, tolerance)
    if solution is not None:
        return solution
    for settings in _ATTEMPTS:
        solution = _solve(qp, replace(settings, tolerance=tolerance))
        if solution is not None:
            return solution
    return None


def _solve(qp: ConicQP, settings: ConicSettings) -> ConicSolution | None:
    q, T, slack_column = len(qp.g), len(qp.weights), len(qp.g) + len(qp.weights)
    dense = np.vstack([_linear_rows(qp, slack_column), *(_cone_rows(cone, q, slack_column) for cone in qp.cones)])
    sides = [qp.upper, -qp.lower, [0.0], qp.rows, qp.epigraph_rows, *(svec(cone.A) for cone in qp.cones)]
    row_count = 2 * q + 1 + len(qp.rows) + len(qp.epigraph_rows)
    solution = solve_conic_program(
        _sparse_upper_triangle(qp.B, slack_column + 1),
        np.concatenate([qp.g, -qp.weights, [qp.penalty]]),
        _constraint_matrix(dense, q, T),
        np.concatenate(sides),
        [nonnegative_cone(row_count), *(semidefinite_cone(len(cone.A)) for cone in qp.cones)],
        settings,
    )
    return None if solution is None else _unpack_solution(qp, *solution, slack_column)


def _linear_rows(qp: ConicQP, slack_column: int) -> np.ndarray:
    """-slack <= 0, -jacobian d - slack <= rows, -epigraph_jacobian d + t_0 <= epigraph_rows, as rows (., q + T + 1)."""
    q, r, h = len(qp.g), len(qp.rows), len(qp.epigraph_rows)
    matrix = np.zeros((1 + r + h, slack_column + 1))
    matrix[: 1 + r, slack_column] = -1.0
    matrix[1 : 1 + r, :q] = -qp.jacobian
    if h:
        matrix[1 + r :, :q], matrix[1 + r :, q] = -qp.epigraph_jacobian, 1.0
    return matrix


def _cone_rows(cone: Cone, q: int, slack_column: int) -> np.ndarray:
    matrix = np.zeros((cone.A.size - len(cone.A) * (len(cone.A) - 1) // 2, slack_column + 1))
    matrix[:, :q] = -svec(cone.D).T
    if cone.epigraph_index is not None:
        matrix[:, q + cone.epigraph_index] = svec(cone.E)
    if cone.slack_factor:
        matrix[:, slack_column] = -cone.slack_factor * svec(np.eye(len(cone.A)))
    return matrix


def _unpack_solution(qp: ConicQP, x: np.ndarray, z: np.ndarray, slack_column: int) -> ConicSolution:
    q, r, h = len(qp.g), len(qp.rows), len(qp.epigraph_rows)
    cone_start = 2 * q + 1 + r + h
    Z, position = [], cone_start
    for cone in qp.cones:
        n = len(cone.A)
        Z.append(smat(z[position : position + n * (n + 1) // 2], n))
        position += n * (n + 1) // 2
    rows = z[2 * q + 1 : 2 * q + 1 + r]
    return ConicSolution(x[:q], float(x[slack_column]), tuple(Z), rows, z[cone_start - h : cone_start], np.maximum(z[:q], z[q : 2 * q]))


def _sparse_upper_triangle(B: np.ndarray, width: int) -> sparse.csc_matrix:
    """Return the upper triangle of B (q, q), padded with zeros to (width, width)."""
    rows, columns, _ = upper_triangle(len(B))
    return _with_entries(_triangle_pattern(len(B), width), B[rows, columns])


@lru_cache(16)
def _triangle_pattern(q: int, width: int) -> sparse.csc_matrix:
    rows, _, _ = upper_triangle(q)
    ends = np.arange(q + 1) * np.arange(1, q + 2) // 2
    return sparse.csc_matrix((np.ones(len(rows)), rows, np.concatenate([ends, np.full(width - q, ends[-1])])), shape=(width, width))


def _constraint_matrix(dense: np.ndarray, q: int, T: int) -> sparse.csc_matrix:
    """Return [I 0; -I 0; dense], the bounds of the q first variables above rows without structure."""
    bounds = np.empty((q, 2 + len(dense)))
    bounds[:, 0], bounds[:, 1], bounds[:, 2:] = 1.0, -1.0, dense[:, :q].T
    return _with_entries(_constraint_pattern(q, T, len(dense)), np.concatenate([bounds.ravel(), dense[:, q:].T.ravel()]))


@lru_cache(64)
def _constraint_pattern(q: int, T: int, row_count: int) -> sparse.csc_matrix:
    row_indices = 2 * q + np.arange(row_count)
    first = [np.concatenate([[j, q + j], row_indices]) for j in range(q)]
    ends = np.cumsum([0, *([row_count + 2] * q), *([row_count] * (T + 1))])
    indices = np.concatenate([*first, *([row_indices] * (T + 1))])
    return sparse.csc_matrix((np.ones(len(indices)), indices, ends), shape=(2 * q + row_count, q + T + 1))


def _with_entries(pattern: sparse.csc_matrix, entries: np.ndarray) -> sparse.csc_matrix:
    """Return a matrix with the rows and columns of another, which is made and looked through once."""
    matrix = copy(pattern)
    matrix.data = entries
    return matrix
