"""One call of Clarabel, and symmetric matrices as the columns that it takes them for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import clarabel as _untyped
import numpy as np
from scipy import sparse

clarabel: Any = _untyped  # its stubs leave out what it has
_ACCEPTED_STATUSES = ("Solved", "AlmostSolved")


@dataclass(frozen=True)
class ConicSettings:
    """Relative and absolute tolerance, iterations at most.

    with_presolve: whether rows are looked through and cones taken apart first; with_equilibration: whether rows and columns are scaled.
    """

    tolerance: float
    max_iterations: int
    with_presolve: bool = True
    with_equilibration: bool = True


def solve_conic_program(
    P: sparse.csc_matrix, q: np.ndarray, A: sparse.csc_matrix, b: np.ndarray, cones: Sequence[Any], settings: ConicSettings
) -> tuple[np.ndarray, np.ndarray] | None:
    """Minimise x'P x / 2 + q'x with b - A x in the cones; return x and the multipliers z, or None where Clarabel gives up.

    P (k, k): the upper triangle; q (k,); A (m, k); b (m,); cones: of `zero_cone`, `nonnegative_cone`, `semidefinite_cone`, m rows in all.
    Source: Goulart and Chen, Clarabel: an interior-point solver for conic programs with quadratic objectives (2024).
    """
    solver = clarabel.DefaultSolver(P, q, A, b, list(cones), _clarabel_settings(settings))
    try:
        solution = solver.solve()
    except BaseException as error:  # a panic of Rust is no Exception
        if type(error).__name__ == "PanicException":
            return None
        raise
    return (np.array(solution.x), np.array(solution.z)) if str(solution.status) in _ACCEPTED_STATUSES else None


@lru_cache(16)
def _clarabel_settings(settings: ConicSettings) -> Any:  # noqa: ANN401
    chosen = clarabel.DefaultSettings()
    chosen.verbose = False
    chosen.max_iter = settings.max_iterations
    chosen.tol_gap_abs = chosen.tol_gap_rel = chosen.tol_feas = settings.tolerance
    chosen.presolve_enable = chosen.chordal_decomposition_enable = settings.with_presolve
    chosen.equilibrate_enable = settings.with_equilibration
    return chosen


def zero_cone(count: int) -> Any:  # noqa: ANN401
    """Return the cone of `count` rows that are 0."""
    return clarabel.ZeroConeT(count)


def nonnegative_cone(count: int) -> Any:  # noqa: ANN401
    """Return the cone of `count` rows that are >= 0."""
    return clarabel.NonnegativeConeT(count)


def semidefinite_cone(n: int) -> Any:  # noqa: ANN401
    """Return the cone of n (n + 1) / 2 rows that are `svec` of a positive semidefinite matrix (n, n)."""
    return clarabel.PSDTriangleConeT(n)


# ---------------------------------------------------------------- symmetric matrices as columns


def svec(S: np.ndarray) -> np.ndarray:
    """Return the upper triangles (..., n (n + 1) / 2) of symmetric S (..., n, n), column by column, off the diagonal times sqrt 2.

    The inner product of two such vectors is that of the matrices. Read from the lower half, row by row, which is the same.
    """
    columns, rows, weights = upper_triangle(S.shape[-1])
    return S[..., rows, columns] * weights


def smat(values: np.ndarray, n: int) -> np.ndarray:
    """Return the symmetric matrices (..., n, n) of vectors (..., n (n + 1) / 2): the inverse of `svec`."""
    rows, columns, weights = upper_triangle(n)
    S = np.empty((*values.shape[:-1], n, n))
    S[..., rows, columns] = S[..., columns, rows] = values / weights
    return S


@lru_cache(32)
def upper_triangle(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows, columns and weights of the upper triangle (n, n), column by column; not to be written to."""
    columns, rows = np.tril_indices(n)  # of the transpose
    triangle = rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))
    for part in triangle:
        part.flags.writeable = False  # they are shared
    return triangle
