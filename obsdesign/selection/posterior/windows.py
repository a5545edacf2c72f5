"""Windows: what the last few choices cost at least, and chains of them, which bound every schedule from below.

A window at segment k is the nodes of the segments i..k; it costs what segment k costs after them when segment i began at its ceiling,
where no schedule knows more: less than in any schedule with these choices, as covariances are monotone in earlier ones. Windows that
begin at segment 0 are exact. A schedule is a chain of windows that overlap in all but one choice; the first ones have one choice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from obsdesign.selection.posterior.problem import PosteriorProblem

Combine: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class WindowLayer:
    """The W windows at one segment: the last node, what overlaps with the windows before (head) and after (tail), cost, covariance.

    head, tail (W,): numbers of windows that are one choice shorter, at the segment before and at this one; n_tails: how many there are.
    amounts (R + 1, W): what the last step switches on costs, and takes of each resource. P (n, n, W): after the last segment.
    """

    node: np.ndarray
    head: np.ndarray
    tail: np.ndarray
    n_tails: int
    cost: np.ndarray
    amounts: np.ndarray
    P: np.ndarray

    def only(self, index: np.ndarray) -> WindowLayer:
        """Return some of the windows."""
        return WindowLayer(
            self.node[index],
            self.head[index],
            self.tail[index],
            self.n_tails,
            self.cost[index],
            self.amounts[:, index],
            self.P[:, :, index],
        )


def smallest_by_key(values: np.ndarray, key: np.ndarray, count: int) -> np.ndarray:
    """Return the smallest of values (..., W) for each key (W,) below count (..., count); inf where there is none."""
    smallest = np.full((*values.shape[:-1], count), np.inf)
    if values.ndim == 1:
        np.minimum.at(smallest, key, values)
    else:
        for row, entries in zip(smallest, values, strict=True):
            np.minimum.at(row, key, entries)
    return smallest


def single_layers(problem: PosteriorProblem) -> list[WindowLayer]:
    """Return windows of one choice, begun at the ceiling, exact at the first segment; what follows what is left out.

    They overlap in nothing, and switch on what the node that may be before them and asks for least does.
    """
    return [_single_layer(problem, k) for k in range(problem.segments)]


def _single_layer(problem: PosteriorProblem, k: int) -> WindowLayer:
    options = problem.options
    node = np.flatnonzero(options.allowed[k] & (options.may_start if k == 0 else True))
    start, nothing = np.full(len(node), -1), np.zeros(len(node), dtype=int)
    cost, amounts, P = problem.advance(k, start, node, np.repeat(problem.ceilings[k][:, :, None], len(node), axis=2))
    layer = WindowLayer(node, nothing, nothing, 1, cost, amounts, P)
    return layer if k == 0 or not options.is_linked else _with_least_switching(problem, k, layer)


def _with_least_switching(problem: PosteriorProblem, k: int, layer: WindowLayer) -> WindowLayer:
    """Return windows of one choice of which each switches on what it does after the node before it with which that is least."""
    options, node = problem.options, layer.node
    before = np.flatnonzero(options.allowed[k - 1])
    may_follow = options.follows[before[:, None], node]
    switching = problem.switching_costs(k, before[:, None], node)
    starts = np.concatenate([switching[None], options.start_usage[:, before[:, None], node]])
    least = np.where(may_follow, starts, np.inf).min(axis=1, initial=np.inf)
    amounts = layer.amounts.copy()
    amounts[0] = least[0]
    count = len(starts) - 1
    amounts[1 : count + 1] = options.usage[:, k, node] + least[1:]
    return replace(layer, amounts=amounts).only(np.flatnonzero(may_follow.any(axis=0)))


def minima_to(layers: list[WindowLayer], values: list[np.ndarray], combine: Combine) -> list[np.ndarray]:
    """Return the least total (..., W) of a chain of windows from the first layer to each window, its own value counted."""
    totals = [values[0]]
    for before, layer, value in zip(layers, layers[1:], values[1:], strict=False):
        totals.append(combine(smallest_by_key(totals[-1], before.tail, before.n_tails)[..., layer.head], value))
    return totals


def minima_after(layers: list[WindowLayer], values: list[np.ndarray], combine: Combine, neutral: float) -> list[np.ndarray]:
    """Return the least total (..., W) of a chain of windows that goes on after each window to the last layer."""
    totals = [np.full(values[-1].shape, neutral)]
    for k in range(len(layers) - 2, -1, -1):
        layer, following = layers[k], layers[k + 1]
        through = combine(values[k + 1], totals[-1])
        totals.append(smallest_by_key(through, following.head, layer.n_tails)[..., layer.tail])
    return totals[::-1]


def cheapest_chain(layers: list[WindowLayer], totals: list[np.ndarray], last: int) -> np.ndarray:
    """Return the windows (K,) of a cheapest chain that ends with a window of the last layer; totals (W,) are `minima_to`."""
    windows = np.empty(len(layers), dtype=int)
    windows[-1] = last
    for k in range(len(layers) - 1, 0, -1):
        matching = np.flatnonzero(layers[k - 1].tail == layers[k].head[windows[k]])
        windows[k - 1] = matching[totals[k - 1][matching].argmin()]
    return windows
