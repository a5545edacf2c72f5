"""What is left of an information matrix for some of the states."""

from __future__ import annotations

import numpy as np

from obsdesign.round_off import spectrum, without_round_off


def shadow(W: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Return W_aa - W_ab W_bb^-1 W_ba for the kept states a (indices): what W says about them while the others are found as well.

    What is left is judged by the sizes of W_aa, of which the rest was taken: a direction that is round-off of these is 0.
    """
    others = np.setdiff1d(np.arange(len(W)), kept)
    if not others.size:
        return W[np.ix_(kept, kept)]
    known, mixed = W[np.ix_(others, others)], W[np.ix_(others, kept)]
    whole = W[np.ix_(kept, kept)]
    return without_round_off(whole - mixed.T @ _solved(known, mixed), np.diag(whole))


def shadow_lift(W: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Return L (n, k) with shadow = L' W L and, to first order, d shadow = L' dW L."""
    others = np.setdiff1d(np.arange(len(W)), kept)
    L = np.zeros((len(W), len(kept)))
    L[kept, np.arange(len(kept))] = 1.0
    if others.size:
        L[others] = -_solved(W[np.ix_(others, others)], W[np.ix_(others, kept)])
    return L


def inverse(W: np.ndarray) -> np.ndarray:
    """Return W^-1 of W (n, n) > 0, solved with unit sizes: right to the digits that its eigenvalues allow, whatever the units.

    Where W is singular to the last bit, (W + n eps I)^-1 in these units, finite: a slope that points where nothing is known.
    """
    d = np.sqrt(np.where(np.diag(W) > 0, np.diag(W), 1.0))
    unit = W / np.outer(d, d)
    try:
        found = np.linalg.inv(unit) / np.outer(d, d)
    except np.linalg.LinAlgError:
        found = np.linalg.inv(unit + len(W) * np.finfo(float).eps * np.eye(len(W))) / np.outer(d, d)
    return (found + found.T) / 2


def _solved(known: np.ndarray, mixed: np.ndarray) -> np.ndarray:
    """W_bb^+ W_ba, by unit sizes: a state that nothing is known of has no entries in W_ba either."""
    found = spectrum(known)
    inverse = np.where(found.hidden, 0.0, 1 / np.where(found.hidden, 1.0, found.values))
    V = found.V / found.d[:, None]
    return V @ (inverse[:, None] * (V.T @ mixed))
