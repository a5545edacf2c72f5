"""How the cost of a schedule changes with what is known on the way: guides a search, proves nothing."""

from __future__ import annotations

import numpy as np

from obsdesign.selection.posterior.problem import PosteriorProblem, Walk

_STEP = 1e-5  # of differences, in units of standard deviations
_NEAR_LARGEST = 0.05  # where the largest counts: how far below it others still weigh, as a share
_FLOOR = 1e-9  # of the largest eigenvalue: slopes are positive definite


def cost_slopes(problem: PosteriorProblem, walk: Walk) -> np.ndarray:
    """Return the adjoint (K + 1, n, n): cost of the segments from k on = <L_k, P_k> to first order about a walk; the last is 0."""
    K, n = walk.covariances.shape[:2]
    deviation = np.sqrt(np.diagonal(walk.covariances, axis1=1, axis2=2))
    unit = deviation[:, :, None] * deviation[:, None, :]
    cost, later = _differences(problem, walk, unit)
    weight = _weights(walk) if problem.is_worst else np.ones(K)
    slopes, (rows, columns) = np.zeros((K + 1, n, n)), np.tril_indices(n)
    for k in range(K - 1, -1, -1):
        slope = np.zeros((n, n))
        slope[rows, columns] = (weight[k] * cost[k] + later[k] @ slopes[k + 1].ravel()) / 2
        e, V = np.linalg.eigh(slope + slope.T)
        slopes[k] = (V * np.maximum(e, _FLOOR * max(e[-1], 1e-300))) @ V.T / unit[k]
    return slopes


def _differences(problem: PosteriorProblem, walk: Walk, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how costs (K, d) and covariances at the end (K, d, n n) of segments change with the entries of those before them."""
    K, n = walk.covariances.shape[:2]
    rows, columns = np.tril_indices(n)
    entries = np.zeros((len(rows), n, n))
    entries[np.arange(len(rows)), rows, columns] = entries[np.arange(len(rows)), columns, rows] = _STEP
    segment = np.repeat(np.arange(K), len(rows))
    option = problem.options.pattern_of_node[walk.nodes][segment]
    change = entries * unit[:, None]
    ends = [
        problem.maps.advance(segment, option, (walk.covariances[:, None] + sign * change).reshape(-1, n, n).transpose(1, 2, 0))
        for sign in (1, -1)
    ]
    with np.errstate(invalid="ignore"):
        cost, P = ((a - b) / (2 * _STEP) for a, b in zip(*ends, strict=True))
    return np.nan_to_num(cost.reshape(K, -1)), np.nan_to_num(P.transpose(2, 0, 1).reshape(K, len(rows), n * n))


def _weights(walk: Walk) -> np.ndarray:
    """Return how much each segment (K,) counts where the largest cost does: all that are near it."""
    costs = np.where(np.isfinite(walk.costs), walk.costs, np.min(walk.costs[np.isfinite(walk.costs)]))
    weight = np.exp((costs - costs.max()) / (_NEAR_LARGEST * max(np.ptp(costs), 1e-300)))
    return weight / weight.sum()
