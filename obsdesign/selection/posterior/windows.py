"""Windows: what the last few choices cost at least, and chains of them, which bound every schedule from below.

A window at segment k is the nodes of the segments i..k; it costs what segment k costs after them when segment i began at its ceiling,
where no schedule knows more: less than in any schedule with these choices, as covariances are monotone in earlier ones. Windows that
begin at segment 0 are exact. A schedule is a chain of windows that overlap in all but one choice.
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


def first_layers(problem: PosteriorProblem) -> list[WindowLayer]:
    """Return windows of two choices, of one at the first segment."""
    options = problem.options
    layers = [_first_layer(problem)]
    single = [layers[0]] + [_single_layer(problem, k) for k in range(1, problem.segments)]
    for k in range(1, problem.segments):
        before, node = np.nonzero(options.follows & options.allowed[k - 1][:, None] & options.allowed[k][None])
        position = np.full(len(options.pattern_of_node), -1)
        position[single[k - 1].node] = np.arange(len(single[k - 1].node))
        is_reached = position[before] >= 0
        before, node = before[is_reached], node[is_reached]
        layers.append(_extend(problem, k, single[k - 1].P[:, :, position[before]], before, node))
    layers[0] = replace(layers[0], tail=layers[0].node, n_tails=len(options.pattern_of_node))
    return layers


def _extend(problem: PosteriorProblem, k: int, P: np.ndarray, before: np.ndarray, node: np.ndarray) -> WindowLayer:
    cost, amounts, P_next = problem.advance(k, before, node, P)
    return WindowLayer(node, before, node, len(problem.options.pattern_of_node), cost, amounts, P_next)


def _first_layer(problem: PosteriorProblem) -> WindowLayer:
    node = np.flatnonzero(problem.options.allowed[0] & problem.options.may_start)
    start = np.full(len(node), -1)
    layer = _extend(problem, 0, np.repeat(problem.P0[:, :, None], len(node), axis=2), start, node)
    return replace(layer, head=np.zeros(len(node), dtype=int))


def _single_layer(problem: PosteriorProblem, k: int) -> WindowLayer:
    """Return windows of one choice, begun at the ceiling: only their covariances are used."""
    node = np.flatnonzero(problem.options.allowed[k])
    P = np.repeat(problem.ceilings[k][:, :, None], len(node), axis=2)
    return _extend(problem, k, P, np.full(len(node), -1), node)


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
