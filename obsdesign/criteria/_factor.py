"""Information matrices: freed from the units of their rows, and what is left of them for some of the states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


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


def shadow(W: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Return W_aa - W_ab W_bb^-1 W_ba for the kept states a (indices): what W says about them while the others are found as well."""
    others = np.setdiff1d(np.arange(len(W)), kept)
    if not others.size:
        return W[np.ix_(kept, kept)]
    known, mixed = W[np.ix_(others, others)], W[np.ix_(others, kept)]
    return W[np.ix_(kept, kept)] - mixed.T @ _solved(known, mixed)


def shadow_lift(W: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Return L (n, k) with shadow = L' W L and, to first order, d shadow = L' dW L."""
    others = np.setdiff1d(np.arange(len(W)), kept)
    L = np.zeros((len(W), len(kept)))
    L[kept, np.arange(len(kept))] = 1.0
    if others.size:
        L[others] = -_solved(W[np.ix_(others, others)], W[np.ix_(others, kept)])
    return L


def _solved(known: np.ndarray, mixed: np.ndarray) -> np.ndarray:
    """W_bb^+ W_ba, by the balanced pseudo-inverse: a state that nothing is known of has no entries in W_ba either."""
    diagonal = np.sqrt(np.maximum(np.diag(known), np.finfo(float).tiny))
    balanced = known / np.outer(diagonal, diagonal)
    return np.linalg.lstsq(balanced, mixed / diagonal[:, None], rcond=len(known) * np.finfo(float).eps)[0] / diagonal[:, None]
