"""Algebra of many small matrices at a time: the batch is last, (n, n, B), so that NumPy's loops run along it."""

from __future__ import annotations

import numpy as np


def add_row(X: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return (X^-1 + r r')^-1 = X - X r r' X / (1 + r'X r), X (n, n, B), r (n, B)."""
    v = X[:, 0] * row[0]
    for j in range(1, len(row)):
        v += X[:, j] * row[j]
    return X - v[:, None] * (v / (1 + np.einsum("ib,ib->b", row, v)))


def product(A: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return A X (m, k, B) of A (m, n, B) and X (n, k, B)."""
    result = A[:, :1] * X[None, 0]
    for j in range(1, A.shape[1]):
        result += A[:, j, None] * X[None, j]
    return result


def congruence(A: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return A X A' (m, m, B), symmetric, of A (m, n, B) and symmetric X (n, n, B)."""
    result = product(A, product(X, A.swapaxes(0, 1)))
    return (result + result.swapaxes(0, 1)) / 2
