"""Deepen and prune: longer and longer windows, without those through which no schedule is better than the best known.

With windows of L choices the cheapest chain bounds every schedule from below. A window through which every chain costs as much as the best
schedule known, or takes more of a resource than there is, need not be looked at again. Windows of L + 1 choices are pairs of
windows of L choices that overlap. When they are as long as the run the bound is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import monotonic
from typing import Protocol

import numpy as np

from obsdesign.selection.posterior.problem import PosteriorProblem, Walk
from obsdesign.selection.posterior.resource_prices import best_prices, threshold
from obsdesign.selection.posterior.windows import WindowLayer, cheapest_chain, minima_after, minima_to, single_layers

MAX_ENTRIES = 16_000_000
"""Numbers of the covariances that are held at a time: 128 MB."""


class AbstractSteps(Protocol):
    """Whatever costs (W,) and takes amounts (R + 1, W)."""

    @property
    def cost(self) -> np.ndarray:
        """Cost of a segment (W,)."""
        ...

    @property
    def amounts(self) -> np.ndarray:
        """Switching costs, and usage of each resource (R + 1, W)."""
        ...


@dataclass(frozen=True, eq=False)
class WorkLimits:
    """What the search may take: windows held at a time, windows simulated in all."""

    max_windows: int
    max_simulated: int

    def share(self, part: float) -> WorkLimits:
        """Return a share of it."""
        return WorkLimits(int(part * self.max_windows), int(part * self.max_simulated))

    def max_held(self, depth: int, n: int) -> int:
        """Return how many windows of `depth` choices may be held; a quarter of all work where they are pairs, the first that tell much."""
        windows = self.max_windows if depth > 2 else max(self.max_windows, self.max_simulated // 4)
        return min(windows, MAX_ENTRIES // n**2)


@dataclass(frozen=True, eq=False)
class Proof:
    """The best schedule known, a bound that no schedule is below, the windows left, how long they are, and how many were simulated."""

    walk: Walk
    bound: float
    chain: Chain
    depth: int
    simulated: int


@dataclass(frozen=True, eq=False)
class Chain:
    """Layers of windows, and what chains through each of them take at least; see `windows`.

    cost_to (M, W), cost_after (M, W): the objective with each of M prices (M, R) for the resources, to each window and after it;
    amounts_to, amounts_after (R + 1, W): what switching costs, and usage, each for itself.
    """

    problem: PosteriorProblem
    layers: list[WindowLayer]
    prices: np.ndarray
    cost_to: list[np.ndarray]
    cost_after: list[np.ndarray]
    amounts_to: list[np.ndarray]
    amounts_after: list[np.ndarray]

    def through(self, k: int) -> np.ndarray:
        """Return what every schedule through each window (W,) costs at least; inf where it would take more than there is."""
        amounts = self.amounts_to[k] + self.amounts_after[k]
        return self._total(self.problem.combine(self.cost_to[k], self.cost_after[k]), amounts)

    def through_pairs(self, k: int, before: np.ndarray, window: np.ndarray) -> np.ndarray:
        """Return what every schedule through windows (B,) of layer k - 1 and windows (B,) of layer k costs at least."""
        layer = self.layers[k]
        own = self.problem.combine(priced_cost(self.problem, layer, self.prices)[:, window], self.cost_after[k][:, window])
        amounts = self.amounts_to[k - 1][:, before] + layer.amounts[:, window] + self.amounts_after[k][:, window]
        return self._total(self.problem.combine(self.cost_to[k - 1][:, before], own), amounts)

    def _total(self, cost: np.ndarray, amounts: np.ndarray) -> np.ndarray:
        return total_cost(self.problem, self.prices, cost, amounts)

    @property
    def bound(self) -> float:
        """What no schedule is below: every one goes through a window of each layer."""
        least = max(float(self.through(k).min(initial=np.inf)) for k in range(len(self.layers)))
        return max(least, threshold(self.problem, self.layers)) if self.problem.is_worst and self.prices.size else least

    def cheapest(self) -> list[np.ndarray]:
        """Return the nodes (K,) of a cheapest chain at each of the prices, without those in which one follows that may not."""
        is_open = np.isfinite(self.through(len(self.layers) - 1))
        lasts = [int(np.where(is_open, totals, np.inf).argmin()) for totals in self.cost_to[-1]]
        chains = [cheapest_chain(self.layers, [totals[m] for totals in self.cost_to], last) for m, last in enumerate(lasts)]
        walks = [np.array([layer.node[w] for layer, w in zip(self.layers, windows, strict=True)]) for windows in chains]
        return [nodes for nodes in walks if self.problem.options.follows[nodes[:-1], nodes[1:]].all()]


def total_cost(problem: PosteriorProblem, prices: np.ndarray, cost: np.ndarray, amounts: np.ndarray) -> np.ndarray:
    """Return the objective (B,) of costs (M, B) at prices (M, R) with amounts (R + 1, B); inf where more is taken than there is."""
    limits = problem.limits
    total = (cost - (prices @ limits)[:, None]).max(axis=0) + (amounts[0] if problem.is_worst else 0.0)
    return np.where((amounts[1:] <= limits[:, None]).all(axis=0), total, np.inf)


def priced_cost(problem: PosteriorProblem, layer: AbstractSteps, prices: np.ndarray) -> np.ndarray:
    """Return what windows add to the objective at each of the prices (M, W): cost, and where costs are sums switching and usage."""
    if problem.is_worst:
        return np.repeat(layer.cost[None], len(prices), axis=0)
    return layer.cost + layer.amounts[0] + prices @ layer.amounts[1:]


def build_chain(problem: PosteriorProblem, layers: list[WindowLayer], prices: np.ndarray) -> Chain:
    """Return the chain of layers with prices (M, R)."""
    costs, amounts = [priced_cost(problem, layer, prices) for layer in layers], [layer.amounts for layer in layers]
    neutral = -np.inf if problem.is_worst else 0.0
    return Chain(
        problem,
        layers,
        prices,
        minima_to(layers, costs, problem.combine),
        minima_after(layers, costs, problem.combine, neutral),
        minima_to(layers, amounts, np.add),
        minima_after(layers, amounts, np.add, 0.0),
    )


def prove(problem: PosteriorProblem, walk: Walk, gap: float, effort: WorkLimits) -> Proof:
    """Return the best schedule and bound that deepening comes to from a first schedule.

    gap: how much below the best known a schedule has to be to be looked for, in the cost's unit. Stops when the gap is closed, when the
    number of windows falls, at the limits of work, and where the deadline would be over before the next windows are there.
    """
    began = monotonic()
    layers, bound, depth, before = single_layers(problem), -np.inf, 1, 0
    simulated = count_windows(layers)

    def has_time(count: int) -> bool:
        """Whether there is time for so many windows, at the pace of those before."""
        return problem.deadline.leaves((monotonic() - began) / max(1, simulated) * count)

    while True:
        chain = build_chain(problem, layers, prices_tried(problem, layers))
        chain_bound = chain.bound
        walk = better_walk(problem, walk, chain.cheapest() if np.isfinite(chain_bound) else [])
        bound = max(bound, min(chain_bound, walk.value - gap))
        if chain_bound >= walk.value - gap or depth >= problem.segments:
            return Proof(walk, bound, chain, depth, simulated)
        chain = prune(chain, walk.value - gap)
        most = min(effort.max_held(depth + 1, len(problem.P0)), effort.max_simulated - simulated)
        pairs = all_open_pairs(chain, walk.value - gap, most)
        count = 0 if pairs is None else sum(len(window) for _, window in pairs)
        if pairs is None or count < before or not has_time(count):
            return Proof(walk, bound, chain, depth, simulated)
        before = count if depth > 1 else 0
        layers, depth = extend_windows(chain, pairs), depth + 1
        simulated += count_windows(layers)


def better_walk(problem: PosteriorProblem, walk: Walk, schedules: Sequence[np.ndarray]) -> Walk:
    """Return the best of a walk and others through nodes (K,), of those that keep the limits."""
    others = [nodes for nodes in schedules if (nodes != walk.nodes).any()]
    candidates = [other for other in problem.walks(others) if problem.is_feasible(other)]
    return min([walk, *candidates], key=lambda each: each.value)


def count_windows(layers: list[WindowLayer]) -> int:
    """Return how many windows there are."""
    return sum(len(layer.node) for layer in layers)


def prune(chain: Chain, limit: float) -> Chain:
    """Return the chain without windows through which every schedule costs at least the limit, numbers of windows made anew."""
    kept = [np.flatnonzero(chain.through(k) < limit) for k in range(len(chain.layers))]
    layers = [layer.only(index) for layer, index in zip(chain.layers, kept, strict=True)]
    return replace(
        chain,
        layers=layers,
        **{
            name: [values[..., index] for values, index in zip(getattr(chain, name), kept, strict=True)]
            for name in ("cost_to", "cost_after", "amounts_to", "amounts_after")
        },
    )


def _pairs(before: WindowLayer, layer: WindowLayer) -> tuple[np.ndarray, np.ndarray]:
    """Return the windows of two layers that overlap, as indices (B,) each."""
    order = np.argsort(before.tail, kind="stable")
    first = np.searchsorted(before.tail[order], layer.head, side="left")
    count = np.searchsorted(before.tail[order], layer.head, side="right") - first
    window = np.repeat(np.arange(len(layer.head)), count)
    offset = np.arange(len(window)) - np.repeat(np.cumsum(count) - count, count)
    return order[np.repeat(first, count) + offset], window


def open_pairs(chain: Chain, k: int, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the windows of layers k - 1 and k that overlap and through both of which a schedule may cost less than the limit."""
    before, window = _pairs(chain.layers[k - 1], chain.layers[k])
    follows = chain.problem.options.follows[chain.layers[k - 1].node[before], chain.layers[k].node[window]]
    before, window = before[follows], window[follows]
    is_open = chain.through_pairs(k, before, window) < limit
    return before[is_open], window[is_open]


def windows_of(depth: int) -> str:
    """Return what proves a bound by windows of so many choices, in words."""
    return f"windows of {depth} segment{'s' if depth > 1 else ''}"


def all_open_pairs(chain: Chain, limit: float, most: float) -> list[tuple[np.ndarray, np.ndarray]] | None:
    """Return `open_pairs` of all layers but the first; None where there are more than so many, or it is late."""
    pairs, count = [], 0
    for k in range(1, len(chain.layers)):
        pairs.append(open_pairs(chain, k, limit))
        count += len(pairs[-1][0])
        if count > most or chain.problem.deadline.is_over:
            return None
    return pairs


def extend_windows(chain: Chain, pairs: list[tuple[np.ndarray, np.ndarray]]) -> list[WindowLayer]:
    """Return windows of one choice more, one for each pair that overlaps; all are simulated at once."""
    problem, layers = chain.problem, chain.layers
    segment = np.repeat(np.arange(1, len(layers)), [len(before) for before, _ in pairs])
    node = np.concatenate([layer.node[window] for layer, (_, window) in zip(layers[1:], pairs, strict=True)])
    previous = np.concatenate([layer.node[before] for layer, (before, _) in zip(layers, pairs, strict=False)])
    P = np.concatenate([layer.P[:, :, before] for layer, (before, _) in zip(layers, pairs, strict=False)], axis=2)
    cost, amounts, P = problem.advance(segment, previous, node, P)
    longer = [replace(layers[0], tail=np.arange(len(layers[0].node)), n_tails=len(layers[0].node))]
    end = 0
    for layer, (before, window) in zip(layers[1:], pairs, strict=True):
        part = slice(end, end := end + len(before))
        # never less, but for rounding
        exact, taken = np.maximum(cost[part], layer.cost[window]), np.maximum(amounts[:, part], layer.amounts[:, window])
        longer.append(WindowLayer(node[part], before, window, len(layer.node), exact, taken, P[:, :, part]))
    return longer


def prices_tried(problem: PosteriorProblem, layers: list[WindowLayer]) -> np.ndarray:
    """Return prices (M, R): none, with which windows as long as the run are exact, and the best ones where these differ."""
    return np.unique([np.zeros(len(problem.limits)), best_prices(problem, layers)], axis=0)
