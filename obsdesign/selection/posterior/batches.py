"""Algebra of many small matrices at a time: the batch is last, (n, n, B), so that NumPy's loops run along it."""

from __future__ import annotations

import numpy as np


def add_row(X: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return (X^-1 + r r')^-1 = X - X r r' X / (1 + r'X r), X (n, n, B), r (n, B)."""
    v = np.einsum("ijb,jb->ib", X, row)
    gain = v / (1 + np.einsum("ib,ib->b", row, v))
    result = v[:, None] * gain
    return np.subtract(X, result, out=result)


def congruence(A: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return A X A' (m, m, B), symmetric, of A (m, n, B) and symmetric X (n, n, B)."""
    result = np.einsum("ijb,jkb->ikb", A, np.einsum("ijb,kjb->ikb", X, A))
    result = result + result.swapaxes(0, 1)
    result *= 0.5
    return result
