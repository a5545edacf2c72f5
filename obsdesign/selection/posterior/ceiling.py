"""What any schedule can know at most at the beginning of a segment: joins in Loewner's order."""

from __future__ import annotations

import numpy as np

from obsdesign.selection.posterior.options import Options
from obsdesign.selection.posterior.segment_maps import SegmentMaps

_MARGIN = 1e-10  # of a join: what rounding may have taken off it
_MAX_JOINED = 4096  # pairs of options that are looked at; else only the last option is exact


def join(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return matrices (B, n, n) above both A and B > 0: T max(e, 1 - e) T' with A = T e T', B = T (1 - e) T'."""
    L = np.linalg.cholesky(A + B)
    L_inverse = np.linalg.inv(L)
    share, V = np.linalg.eigh(L_inverse @ A @ L_inverse.swapaxes(-1, -2))
    T = L @ V
    return (T * np.maximum(share, 1 - share)[:, None, :]) @ T.swapaxes(-1, -2) * (1 + _MARGIN)


def join_all(matrices: np.ndarray) -> np.ndarray:
    """Return a matrix (n, n) above all of (B, n, n), by pairs."""
    while len(matrices) > 1:
        half = len(matrices) // 2
        joined = join(matrices[:half], matrices[half : 2 * half])
        matrices = np.concatenate([joined, matrices[2 * half :]])
    return matrices[0]


def ceilings(maps: SegmentMaps, options: Options, P0: np.ndarray) -> np.ndarray:
    """Return P (K, n, n) before the first samples of each segment with P <= P_k for every schedule; exact at k = 0.

    P_k+1^-1 = the join over all options of the last two segments, begun at P_k-1: covariances are monotone in earlier ones.
    """
    floors = [P0]
    for k in range(1, len(maps.instants)):
        last = _options_in(options, k - 1)
        before = _options_in(options, k - 2) if k > 1 else last[:0]
        if k > 1 and len(before) * len(last) <= _MAX_JOINED:
            P = maps.advance(k - 2, before, _repeat(floors[k - 2], len(before)))[1]
            P = np.repeat(P, len(last), axis=2)
            P_next = maps.advance(k - 1, np.tile(last, len(before)), P)[1]
        else:
            P_next = maps.advance(k - 1, last, _repeat(floors[k - 1], len(last)))[1]
        floors.append(invert(join_all(np.linalg.inv(P_next.transpose(2, 0, 1)))))
    return np.array(floors)


def invert(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse (n, n) of a symmetric matrix, symmetric."""
    inverse = np.linalg.inv(matrix)
    return (inverse + inverse.T) / 2


def _options_in(options: Options, k: int) -> np.ndarray:
    return np.unique(options.pattern_of_node[options.allowed[k]])


def _repeat(P: np.ndarray, count: int) -> np.ndarray:
    return np.repeat(P[:, :, None], count, axis=2)
