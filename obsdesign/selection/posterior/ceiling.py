"""What any schedule can know at most at the beginning of a segment: covariances below others in Loewner's order."""

from __future__ import annotations

import numpy as np

from obsdesign.selection.posterior.deadline import Deadline
from obsdesign.selection.posterior.options import Options
from obsdesign.selection.posterior.segment_maps import SegmentMaps

_MARGIN = 1e-10  # of a meet: what rounding may have added to it
_RIDGE = 1e-14  # on a unit diagonal, so that it has a Cholesky factor
_MAX_JOINED = 4096  # pairs of options that are looked at; else only the last option is exact


def meet(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return covariances (B, n, n) below both A and B >= 0: T min(e, 1 - e) T' with A = T e T', B = T (1 - e) T'.

    It is the inverse of T^-T max(1 / e, 1 / (1 - e)) T^-1, which is above both informations. 0 where rounding has left A + B indefinite.
    """
    deviation = np.sqrt(np.maximum(np.diagonal(A + B, axis1=-2, axis2=-1), 0.0))
    unit = deviation[..., :, None] * deviation[..., None, :]
    L, is_factored = _factor((A + B) / np.where(unit > 0, unit, 1.0) + _RIDGE * np.eye(A.shape[-1]))
    L_inverse = np.linalg.inv(L)
    share, V = np.linalg.eigh(L_inverse @ (A / np.where(unit > 0, unit, 1.0)) @ L_inverse.swapaxes(-1, -2))
    T = deviation[..., :, None] * (L @ V)
    smaller = np.maximum(np.minimum(share, 1 - share) * (1 - _MARGIN) - _RIDGE * A.shape[-1], 0.0)
    return (T * (smaller * is_factored[..., None])[..., None, :]) @ T.swapaxes(-1, -2)


def _factor(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Cholesky factors (B, n, n) and where there is one (B,); elsewhere I: nothing but 0 is then known to be below."""
    try:
        return np.linalg.cholesky(matrices), np.ones(len(matrices), dtype=bool)
    except np.linalg.LinAlgError:
        is_positive = np.linalg.eigvalsh(matrices)[..., 0] > _RIDGE / 10
        usable = np.where(is_positive[..., None, None], matrices, np.eye(matrices.shape[-1]))
        return np.linalg.cholesky(usable), is_positive


def meet_of_groups(covariances: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """Return covariances (n, n, count) below all members of each group, by pairs; covariances (n, n, B), group (B,) below count."""
    order = np.argsort(group, kind="stable")
    P, group = covariances.transpose(2, 0, 1)[order], group[order]
    while len(group) > count:
        place = np.arange(len(group)) - np.searchsorted(group, group)
        first = np.flatnonzero((place % 2 == 0)[:-1] & (group[1:] == group[:-1]))
        P[first] = meet(P[first], P[first + 1])
        stays = np.ones(len(group), dtype=bool)
        stays[first + 1] = False
        P, group = P[stays], group[stays]
    return P.transpose(1, 2, 0)


def ceilings(maps: SegmentMaps, options: Options, P0: np.ndarray, deadline: Deadline) -> np.ndarray:
    """Return P (K, n, n) before the first samples of each segment with P <= P_k for every schedule; exact at k = 0.

    P_k+1 is below what all options of the last two segments end with from P_k-1: covariances are monotone in earlier ones.
    0, which is below all, from where the deadline is over.
    """
    floors = [P0]
    for k in range(1, len(maps.instants)):
        if deadline.is_over:
            floors.append(np.zeros_like(P0))
            continue
        last = _options_in(options, k - 1)
        before = _options_in(options, k - 2) if k > 1 else last[:0]
        if k > 1 and len(before) * len(last) <= _MAX_JOINED:
            P = maps.advance(k - 2, before, _repeat(floors[k - 2], len(before)))[1]
            P = np.repeat(P, len(last), axis=2)
            P_next = maps.advance(k - 1, np.tile(last, len(before)), P)[1]
        else:
            P_next = maps.advance(k - 1, last, _repeat(floors[k - 1], len(last)))[1]
        floors.append(meet_of_groups(P_next, np.zeros(P_next.shape[2], dtype=int), 1)[:, :, 0])
    return np.array(floors)


def _options_in(options: Options, k: int) -> np.ndarray:
    return np.unique(options.pattern_of_node[options.allowed[k]])


def _repeat(P: np.ndarray, count: int) -> np.ndarray:
    return np.repeat(P[:, :, None], count, axis=2)
