"""Which partial schedules are alike: cells of covariance and cost, split where joining costs a bound most; proves nothing by itself."""

from __future__ import annotations

import numpy as np

from obsdesign.selection.posterior.batches import congruence

_ROUNDS = 40
_ALIKE = 1e-12  # of the size of costs: cells that are narrower are not split


def cluster(group: np.ndarray, cost: np.ndarray, P: np.ndarray, slope: np.ndarray, width: int, tolerance: float) -> np.ndarray:
    """Return the cell (B,) of each partial schedule, numbers 0.. without gaps; only members of a group (B,) share a cell.

    cost (B,) + <slope, P> is what is expected of a schedule, P (n, n, B). A cell's join costs at least about the least cost and the least
    of each coordinate in units where the slope is I. Cells where that is no more than `tolerance` above the best schedule are
    halved along the coordinate that differs most, the lowest first, until there are `width` of them.
    """
    X, diagonal = _coordinates(cost, P, slope)
    best, narrow = (X[0] + X[1:][diagonal].sum(axis=0)).min(), _ALIKE * np.abs(X[0]).max()
    cell = np.unique(group, return_inverse=True)[1]
    count, active = int(cell.max()) + 1, np.arange(len(cell))
    for _ in range(_ROUNDS):
        order = active[np.argsort(cell[active], kind="stable")]
        present, starts = np.unique(cell[order], return_index=True)
        low, high = np.minimum.reduceat(X[:, order], starts, axis=1), np.maximum.reduceat(X[:, order], starts, axis=1)
        spread = high - low
        floor = low[0] + low[1:][diagonal].sum(axis=0) - spread[1:][~diagonal].sum(axis=0) / 2
        chosen = np.flatnonzero((spread.max(axis=0) > narrow) & (floor < best + tolerance))
        chosen = chosen[np.argsort(floor[chosen], kind="stable")][: max(0, width - count)]
        if not len(chosen):
            break
        new, along = np.full(len(present), -1), spread.argmax(axis=0)
        new[chosen] = count + np.arange(len(chosen))
        place = np.repeat(np.arange(len(present)), np.diff(np.append(starts, len(order))))
        middle = (low + high)[along, np.arange(len(present))] / 2
        is_split = new[place] >= 0
        is_upper = is_split & (X[along[place], order] > middle[place])
        cell[order[is_upper]] = new[place[is_upper]]
        count, active = count + len(chosen), order[is_split]
    return cell


def _coordinates(cost: np.ndarray, P: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return cost and entries of L'PL (1 + d, B), slope = LL', those off the diagonal times the root of 2, and which are on it (d,)."""
    deviation = np.sqrt(np.abs(np.einsum("iib->i", P)) / P.shape[2])
    e, V = np.linalg.eigh(slope * deviation[:, None] * deviation)
    L = V * np.sqrt(np.maximum(e, 0.0)) / np.where(deviation > 0, deviation, 1.0)[:, None]
    rows, columns = np.tril_indices(len(slope))
    entries = congruence(np.broadcast_to(L.T[:, :, None], P.shape), P)[rows, columns]
    is_diagonal = rows == columns
    return np.vstack([cost, np.where(is_diagonal[:, None], entries, np.sqrt(2) * entries)]), is_diagonal
