"""Lower-triangular factors as NLP variables, shared by the lifts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import casadi as ca


def lower_triangular(name: str, n: int) -> ca.SX:
    """Return a symbolic lower-triangular matrix (n, n)."""
    import casadi as ca

    return ca.SX.sym(name, ca.Sparsity.lower(n))


def entries(L: ca.SX) -> ca.SX:
    """Return the n(n+1)/2 entries of a lower-triangular L as a column, by columns."""
    return L.nz[:]


def entries_of(L: np.ndarray) -> np.ndarray:
    """Return the same entries of a numerical L (n, n)."""
    rows, columns = np.tril_indices(len(L))
    order = np.lexsort((rows, columns))
    return L[rows[order], columns[order]]


def diagonal_at_least(n: int, floor: float) -> np.ndarray:
    """Return lower bounds for `entries`: floor on the diagonal (it removes sign copies), none elsewhere."""
    return entries_of(np.where(np.eye(n, dtype=bool), floor, -np.inf))


def lower_entries(A: ca.SX) -> ca.SX:
    """Return the lower triangle of a square A as a column: what an equality of symmetric matrices says once."""
    import casadi as ca

    return ca.vertcat(*[A[i, j] for j in range(A.shape[0]) for i in range(j, A.shape[0])])


def nearest_factor(A: np.ndarray) -> np.ndarray:
    """Return the Cholesky factor of A (n, n), with eigenvalues below 1e-12 of the largest raised to that."""
    values, vectors = np.linalg.eigh(A)
    raised = np.maximum(values, 1e-12 * max(values[-1], 1.0))
    return np.linalg.cholesky((vectors * raised) @ vectors.T)


@dataclass(frozen=True)
class Balanced:
    """W = D V diag(values) V' D with D = diag(W)^1/2: the eigenvalues of W freed from the units of its rows."""

    d: np.ndarray  # diagonal of D
    values: np.ndarray
    V: np.ndarray


def balanced(W: np.ndarray) -> Balanced | None:
    """Return W (n, n) with unit diagonal as eigenvalues and vectors, or None where it is singular to double precision."""
    diagonal = np.diag(W)
    if not (diagonal > 0).all():
        return None
    d = np.sqrt(diagonal)
    values, V = np.linalg.eigh(W / np.outer(d, d))
    return Balanced(d, values, V) if values[0] > len(W) * np.finfo(float).eps * values[-1] else None
