"""What of a sum of information is there, and what is only the rounding of the numbers that were added."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from obsdesign.arguments import validate_arguments
from obsdesign.checks import as_array
from obsdesign.errors import InputError

EPS = float(np.finfo(float).eps)
_ROUNDINGS = 8  # of one entry of a sum: its products and its additions, each at most eps of the sizes added
_LEAK = 0.1  # squared share of a hidden direction in a state, below which rounding has put it there
_PLAIN = 1e-6  # a matrix whose eigenvalues are within this ratio is nowhere near singular, in whatever units


@dataclass(frozen=True, eq=False)
class Spectrum:
    """W = D V diag(values) V' D, all with leading axes of their own: eigenvalues freed from the units of the states.

    d (..., n): the diagonal of D, in 1/unit of each state; values (..., n) ascending and V (..., n, n): of W with D taken out;
    hidden (..., n): which of them are round-off.
    """

    d: np.ndarray
    values: np.ndarray
    V: np.ndarray
    hidden: np.ndarray

    @property
    def is_singular(self) -> np.ndarray:
        """Whether a direction is hidden (...)."""
        return np.asarray(self.hidden.any(axis=-1))


def resolution(n: int) -> float:
    """Return 8 n eps: what rounding makes of an eigenvalue 0 of a sum W (n, n), its sizes scaled to 1; see docs/information.md."""
    return _ROUNDINGS * n * EPS


def spectrum(W: np.ndarray, sizes: np.ndarray | None = None) -> Spectrum:
    """Return the eigenvalues of W (..., n, n) >= 0 with unit sizes, and which of them are round-off.

    An entry W_ij is known to 8 eps sqrt(s_i s_j), with sizes s (..., n) of what was added for each diagonal entry; None: the diagonal
    itself, for a sum of positive blocks, by Cauchy and Schwarz. So, in any units, what is hidden is what is below 8 n eps of
    W_ij / sqrt(s_i s_j).
    """
    W = np.asarray(W, dtype=float)
    diagonal = np.diagonal(W, axis1=-2, axis2=-1) if sizes is None else np.asarray(sizes, dtype=float)
    d = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, V = np.linalg.eigh(W / d[..., :, None] / d[..., None, :])
    return Spectrum(d, values, V, values <= resolution(W.shape[-1]))


def hidden_directions(W: np.ndarray, sizes: np.ndarray | None = None) -> np.ndarray:
    """Return the directions of the state (n, p), columns in the units of the states, that a sum W (n, n) does not see."""
    found = spectrum(W, sizes)
    return found.V[:, found.hidden] / found.d[:, None]


@validate_arguments
def standard_deviations(J: ArrayLike, sizes: np.ndarray | None = None) -> np.ndarray:
    """Return sqrt(diag(J^-1)) (..., n) in the units of the states; inf for a state that a hidden direction of J (..., n, n) moves.

    sizes (..., n): of what was added for each diagonal entry, None = the diagonal itself; see `spectrum`.
    """
    matrices = as_array("J", J)
    if matrices.ndim < 2 or matrices.shape[-1] != matrices.shape[-2]:
        raise InputError(f"J has shape {matrices.shape}: must be (..., n, n)")
    added = None if sizes is None else as_array("sizes", sizes)
    if added is not None and added.shape != matrices.shape[:-1]:
        raise InputError(f"sizes has shape {added.shape}: must be {matrices.shape[:-1]}, one for each diagonal entry")
    found = spectrum(matrices, added)
    return deviations(found) / found.d


def deviations(found: Spectrum) -> np.ndarray:
    """Return sqrt(diag(W^-1)) (..., n) in units of 1/d, inf where hidden.

    A hidden direction is computed with what rounding mixes into it of the directions that are seen, at most a small share of what
    these leave unknown: a state it moves by less than that is not moved.
    """
    squares = found.V**2
    known = np.where(found.hidden, 0.0, 1 / np.where(found.hidden, 1.0, found.values))
    variances = np.einsum("...ij,...j->...i", squares, known)
    moved = np.einsum("...ij,...j->...i", squares, found.hidden.astype(float)) / resolution(squares.shape[-1])
    return np.where(moved > _LEAK * variances, np.inf, np.sqrt(variances))


def without_round_off(W: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return W (n, n) with its hidden directions at 0, W itself where there are none; sizes (n,) as for `spectrum`."""
    found = spectrum(W, sizes)
    if not found.is_singular:
        return W
    root = found.V * np.sqrt(np.where(found.hidden, 0.0, found.values)) * found.d[:, None]
    return root @ root.T


def smallest_eigenvalue(W: np.ndarray) -> float:
    """Return lambda_min of W (n, n) >= 0: 0 where a direction is hidden, otherwise right to the digits that W has of it.

    Where the units of the states are decades apart it is found as 1 / lambda_max(W^-1), by the eigenvalues with unit sizes.
    """
    values = np.linalg.eigvalsh(W)
    lowest, highest = float(values[0]), float(values[-1])
    if lowest > _PLAIN * highest or lowest < -resolution(len(W)) * highest:
        return lowest
    found = spectrum(W)
    if found.is_singular:
        return 0.0
    least = float(found.d.min())
    root = found.V / np.sqrt(found.values) * (least / found.d)[:, None]
    return least**2 / float(np.linalg.norm(root, 2)) ** 2
