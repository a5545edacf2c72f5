"""Prices of what is limited in sum, with which chains of windows bound from highest: the Lagrangian dual of the limits.

L(mu) = min over chains of cost + mu'usage - mu'limits is below the cost of every schedule that keeps the limits, for every mu >= 0,
concave and piecewise linear; usage - limits of a cheapest chain is a slope. Where the largest cost counts instead of the sum, the
bound is a threshold: the smallest c such that chains of windows that cost at most c can keep every limit.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from obsdesign.selection.posterior.problem import PosteriorProblem
from obsdesign.selection.posterior.windows import WindowLayer, cheapest_chain, minima_to

_MAX_CUTS = 24  # cheapest chains looked for
_CLOSE = 1e-4  # of the cost: how near to the best prices is near enough
_FIRST_BOX = 4.0  # prices up to which all of a limit is worth so many times the cost; larger where the best is at the edge
_LARGEST_BOX = 1e6


def best_prices(problem: PosteriorProblem, layers: list[WindowLayer]) -> np.ndarray:
    """Return prices (R,) >= 0 of the resources with which the chain bounds about as high as it can; 0 where the largest cost counts.

    Kelley's cutting planes: the next prices are those at which the least of all tangents so far is highest.
    """
    limits = problem.limits
    if not len(limits) or problem.is_worst:
        return np.zeros(len(limits))
    value, usage = priced_chain(layers, np.zeros(len(limits)))
    if not np.isfinite(value) or (usage <= limits).all():
        return np.zeros(len(limits))
    # a unit of each resource: its limit, or where that is next to nothing what the cheapest chain takes
    units = np.maximum(limits, usage / 4)
    size = max(abs(value), 1e-300)
    return size / units * _highest(lambda mu: _dual(layers, mu, size / units, limits, size), len(limits))


def _dual(layers: list[WindowLayer], mu: np.ndarray, unit_prices: np.ndarray, limits: np.ndarray, size: float) -> tuple[float, np.ndarray]:
    """Return L / size and its slope (R,) at prices mu * unit_prices."""
    value, usage = priced_chain(layers, mu * unit_prices)
    excess = (usage - limits) * unit_prices / size
    return value / size - float(mu @ (limits * unit_prices)) / size, excess


def _highest(dual: Callable[[np.ndarray], tuple[float, np.ndarray]], R: int) -> np.ndarray:
    """Return where a concave function of mu (R,) >= 0, given with its slopes, is highest, nearly."""
    mu, edge = np.zeros(R), np.full(R, _FIRST_BOX)
    best, best_value = mu, -np.inf
    values, slopes, places = [], [], []
    for _ in range(_MAX_CUTS):
        value, slope = dual(mu)
        if value > best_value:
            best, best_value = mu, value
        values.append(value)
        slopes.append(slope)
        places.append(mu)
        offsets = np.array(values) - np.einsum("ir,ir->i", np.array(slopes), np.array(places))
        mu, ceiling = _model_maximum(np.array(slopes), offsets, edge)
        at_edge = (mu >= 0.999 * edge) & (edge < _LARGEST_BOX)
        if not at_edge.any() and ceiling - best_value <= _CLOSE:
            break
        edge = np.where(at_edge, 8 * edge, edge)
    return best


def _model_maximum(slopes: np.ndarray, offsets: np.ndarray, edge: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the mu (R,) in [0, edge] with the highest min_i offsets_i + slopes_i'mu, and that height."""
    from scipy import optimize

    R = len(edge)
    rows = np.hstack([-slopes, np.ones((len(slopes), 1))])
    solution = optimize.linprog(
        np.append(np.zeros(R), -1.0), rows, offsets, bounds=[*((0.0, top) for top in edge), (None, None)], method="highs"
    )
    return np.clip(solution.x[:R], 0.0, edge), float(solution.x[R])


def priced_chain(layers: list[WindowLayer], prices: np.ndarray) -> tuple[float, np.ndarray]:
    """Return what a cheapest chain costs with prices (R,), and what it takes of each resource (R,); inf and nothing without a chain."""
    values = [layer.cost + layer.amounts[0] + prices @ layer.amounts[1:] for layer in layers]
    totals = minima_to(layers, values, np.add)
    if not np.isfinite(totals[-1]).any():
        return np.inf, np.zeros(len(prices))
    windows = cheapest_chain(layers, totals, int(totals[-1].argmin()))
    usage = np.sum([layer.amounts[1:, window] for layer, window in zip(layers, windows, strict=True)], axis=0)
    return float(totals[-1].min()), usage


def threshold(problem: PosteriorProblem, layers: list[WindowLayer]) -> float:
    """Return what the largest cost is at least where limits are kept: chains of windows below it take too much of some resource."""
    levels = np.unique(np.concatenate([layer.cost for layer in layers]))
    low, high = 0, len(levels)
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if _can_keep_limits(problem, layers, levels[middle]) else (middle + 1, high)
    return float(levels[low]) if low < len(levels) else np.inf


def _can_keep_limits(problem: PosteriorProblem, layers: list[WindowLayer], level: float) -> bool:
    amounts = [np.where(layer.cost <= level, layer.amounts[1:], np.inf) for layer in layers]
    smallest = minima_to(layers, amounts, np.add)[-1].min(axis=1, initial=np.inf)
    return bool((smallest <= problem.limits).all())
