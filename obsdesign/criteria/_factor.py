"""What is left of an information matrix for some of the states."""

from __future__ import annotations

import numpy as np

from obsdesign.round_off import spectrum, without_round_off


def schur_complement(W: np.ndarray, retained: np.ndarray) -> np.ndarray:
    """Return W_aa - W_ab W_bb^-1 W_ba for the kept states a (indices): what W says about them while the others are found as well.

    What is left is judged by the sizes of W_aa, of which the rest was taken: a direction that is round-off of these is 0.
    """
    eliminated = np.setdiff1d(np.arange(len(W)), retained)
    if not eliminated.size:
        return W[np.ix_(retained, retained)]
    eliminated_block, cross_block = W[np.ix_(eliminated, eliminated)], W[np.ix_(eliminated, retained)]
    retained_block = W[np.ix_(retained, retained)]
    return without_round_off(retained_block - cross_block.T @ _pseudo_solve(eliminated_block, cross_block), np.diag(retained_block))


def elimination_matrix(W: np.ndarray, retained: np.ndarray) -> np.ndarray:
    """Return L (n, k) with the Schur complement C = L' W L and, to first order, dC = L' dW L."""
    eliminated = np.setdiff1d(np.arange(len(W)), retained)
    L = np.zeros((len(W), len(retained)))
    L[retained, np.arange(len(retained))] = 1.0
    if eliminated.size:
        L[eliminated] = -_pseudo_solve(W[np.ix_(eliminated, eliminated)], W[np.ix_(eliminated, retained)])
    return L


def inverse(W: np.ndarray) -> np.ndarray:
    """Return W^-1 of W (n, n) > 0, solved with unit sizes: right to the digits that its eigenvalues allow, whatever the units.

    Where W is singular to the last bit, (W + n eps I)^-1 in these units, finite: a slope that points where nothing is known.
    """
    d = np.sqrt(np.where(np.diag(W) > 0, np.diag(W), 1.0))
    unit = W / np.outer(d, d)
    try:
        result = np.linalg.inv(unit) / np.outer(d, d)
    except np.linalg.LinAlgError:
        result = np.linalg.inv(unit + len(W) * np.finfo(float).eps * np.eye(len(W))) / np.outer(d, d)
    return (result + result.T) / 2


def _pseudo_solve(block: np.ndarray, right_side: np.ndarray) -> np.ndarray:
    """W_bb^+ W_ba, by unit sizes: a state that nothing is known of has no entries in W_ba either."""
    decomposition = spectrum(block)
    inverse = np.where(decomposition.is_hidden, 0.0, 1 / np.where(decomposition.is_hidden, 1.0, decomposition.values))
    V = decomposition.V / decomposition.unit_sizes[:, None]
    return V @ (inverse[:, None] * (V.T @ right_side))
