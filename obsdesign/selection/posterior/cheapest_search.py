"""The cheapest walk that keeps every limit, and a bound on its cost: the windows of `deepening`, where limits do the work.

A window counts the instants that break a requirement from the covariance that it begins with, above which no schedule knows more: never
too many. A chain of windows within the limits that costs least is a bound; one that keeps them in truth is an answer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from obsdesign.selection.posterior.deepening import (
    MAX_ENTRIES,
    Chain,
    WorkLimits,
    all_open_pairs,
    build_chain,
    count_windows,
    extend_windows,
    prices_tried,
    prune,
    windows_of,
)
from obsdesign.selection.posterior.few_schedules import all_tried, few_walks
from obsdesign.selection.posterior.problem import PosteriorProblem, Walk
from obsdesign.selection.posterior.trellis import best_by_key, trellis_width
from obsdesign.selection.posterior.windows import WindowLayer, single_layers

_EFFORT = WorkLimits(max_windows=400_000, max_simulated=3_000_000)
_MAX_TRELLIS = 4096  # partial walks of a trellis
_WORTH = (0.0, 0.03, 0.1, 0.3, 1.0, 3.0)  # of a unit of cost: what a factor e in the volume of an ellipsoid of errors is worth
_SUM_ROUNDING = 1e-12  # of a sum of costs: what rounding may add to it
_UNIT_ROUNDING = 1e-6  # of a unit: what rounding may add to a sum of costs


@dataclass(frozen=True, eq=False)
class Target:
    """What is looked for: keeps says in full whether nodes (K,) keep every limit; unit: all costs are whole multiples of it, 0 = none.

    gap: how near to the least the cost is wanted.
    """

    keeps: Callable[[np.ndarray], bool]
    unit: float
    gap: float

    def wanted_below(self, value: float) -> float:
        """Return what a better walk costs less than."""
        return value - max(max(self.gap, 2 * _SUM_ROUNDING) * value, self.unit * (1 - 2 * _UNIT_ROUNDING))

    def round_up(self, bound: float) -> float:
        """Return the least whole multiple of the unit that is no less than a bound; without a unit, the bound less rounding."""
        if not self.unit or not np.isfinite(bound):
            return max(0.0, bound * (1 - _SUM_ROUNDING))
        return self.unit * float(np.ceil(bound / self.unit - _UNIT_ROUNDING))


@dataclass(frozen=True, eq=False)
class Cheapest:
    """The cheapest walk known, None without one, what none costs less than, inf where there is none, and what proves that, in words."""

    walk: Walk | None
    bound: float
    bound_by: str


def search_cheapest(problem: PosteriorProblem, target: Target, steps: int) -> Cheapest:
    """Return the cheapest walk along a path of so many steps and a bound; where windows leave it open, few schedules are tried."""
    answer = _search_windows(problem, target)
    is_closed = answer.walk is not None and answer.bound >= target.wanted_below(answer.walk.value)
    few = None if is_closed or np.isposinf(answer.bound) else few_walks(problem.options, steps)
    return answer if few is None else _cheapest_of_few(problem, target, few) or answer


def _cheapest_of_few(problem: PosteriorProblem, target: Target, few: np.ndarray) -> Cheapest | None:
    """Return the cheapest of walks (B, K) that keeps every limit; None where there is no time for all that cost less."""
    before = np.hstack([np.full((len(few), 1), -1), few[:, :-1]])
    k = np.arange(problem.segments)
    on_costs = 0.0 if problem.purchase is None else problem.purchase.on_costs[k, few].sum(axis=1)
    for nodes in few[np.argsort(on_costs + problem.switching_costs(k, before, few).sum(axis=1), kind="stable")]:
        if problem.deadline.is_over:
            return None
        if target.keeps(nodes):
            walk = problem.walk(nodes)
            return Cheapest(walk, walk.value, all_tried(few))
    return Cheapest(None, np.inf, all_tried(few))


def _search_windows(problem: PosteriorProblem, target: Target) -> Cheapest:
    """Return the cheapest walk and a bound: deeper and deeper windows, without those that a better walk does not pass through."""
    walk, bound, depth = first_purchase(problem, target), -np.inf, 1
    layers, simulated = single_layers(problem), 0
    while True:
        layers = [layer.only(np.flatnonzero((layer.amounts[1:] <= problem.limits[:, None]).all(axis=0))) for layer in layers]
        simulated += count_windows(layers)
        chain = build_chain(problem, layers, prices_tried(problem, layers))
        chain_bound = target.round_up(chain.bound)
        walk = _cheaper(problem, target, walk, chain.cheapest() if np.isfinite(chain_bound) else [])
        limit = np.inf if walk is None else target.wanted_below(walk.value)
        bound = max(bound, min(chain_bound, target.round_up(limit)))
        if chain_bound >= limit or depth >= problem.segments:
            return Cheapest(walk, bound, windows_of(depth))
        longer = _deeper(chain, limit, simulated)
        if longer is None:
            return Cheapest(walk, bound, windows_of(depth))
        layers, depth = longer, depth + 1


def _deeper(chain: Chain, limit: float, simulated: int) -> list[WindowLayer] | None:
    """Return windows of one choice more through which a walk may cost less than the limit; None where they are too many, or it is late."""
    chain = prune(chain, limit)
    most = min(
        _EFFORT.max_windows,
        MAX_ENTRIES // len(chain.problem.P0) ** 2,
        _EFFORT.max_simulated * chain.problem.step_share - simulated,
    )
    pairs = all_open_pairs(chain, limit, most)
    return None if pairs is None else extend_windows(chain, pairs)


def _cheaper(problem: PosteriorProblem, target: Target, walk: Walk | None, candidates: list[np.ndarray]) -> Walk | None:
    """Return the cheapest walk that keeps the limits of one known and candidates (K,)."""
    for nodes in candidates:
        candidate = problem.walk(nodes)
        if problem.is_feasible(candidate) and (walk is None or candidate.value < walk.value) and target.keeps(nodes):
            walk = candidate
    return walk


def first_purchase(problem: PosteriorProblem, target: Target) -> Walk | None:
    """Return the cheapest walk of trellises that weigh cost against knowledge in several ways, until the deadline."""
    walk, nodes = None, len(problem.options.pattern_of_node)
    unit = 1.0 if problem.purchase is None else float(problem.purchase.on_costs.mean(axis=0).max())
    width = trellis_width(problem, 1 / len(_WORTH))
    for depth in (1, 2):
        if depth > 1 and nodes ** (depth + 1) > _MAX_TRELLIS:
            break
        for worth in _WORTH:
            if walk is not None and problem.deadline.is_over:
                return walk
            walk = _cheaper(problem, target, walk, follow_purchases(problem, depth, worth * unit, width))
    return walk


@dataclass(frozen=True, eq=False)
class _Purchases:
    """Partial walks: last node (B,), what they cost (B,) and take of what is limited (R, B), P (n, n, B), the choices so far (B, k)."""

    node: np.ndarray
    cost: np.ndarray
    amounts: np.ndarray
    P: np.ndarray
    choices: np.ndarray

    def only(self, index: np.ndarray) -> _Purchases:
        """Return some of them."""
        return _Purchases(self.node[index], self.cost[index], self.amounts[:, index], self.P[:, :, index], self.choices[index])


def follow_purchases(problem: PosteriorProblem, depth: int, worth: float, width: int) -> list[np.ndarray]:
    """Return the nodes (K,) of the cheapest walk of a trellis within the limits, in a list; none where all of its walks break one.

    For every choice of the last `depth` segments the walk with the least cost + worth * log det P stays; of more than `width`
    the best, one from when the deadline is over.
    """
    R, nodes = len(problem.limits), len(problem.options.pattern_of_node)
    walks = _Purchases(np.array([-1]), np.zeros(1), np.zeros((R, 1)), problem.P0[:, :, None], np.zeros((1, 0), dtype=int))
    for k in range(problem.segments):
        walks = _step(problem, walks, k)
        score = walks.cost + worth * np.linalg.slogdet(walks.P.transpose(2, 0, 1))[1]
        key = walks.choices[:, -depth:] @ nodes ** np.arange(min(depth, k + 1))
        walks = walks.only(best_by_key(key, score, 1 if problem.deadline.is_over else width))
    return [walks.choices[int(walks.cost.argmin())]] if len(walks.cost) else []


def _step(problem: PosteriorProblem, walks: _Purchases, k: int) -> _Purchases:
    """Return all walks that go on into segment k within the limits."""
    options = problem.options
    may_follow = np.vstack([options.follows, options.may_start])[walks.node] & options.allowed[k]
    parent, node = np.nonzero(may_follow)
    cost, amounts, P = problem.advance(k, walks.node[parent], node, walks.P[:, :, parent])
    total = walks.amounts[:, parent] + amounts[1:]
    choices = np.concatenate([walks.choices[parent], node[:, None]], axis=1)
    longer = _Purchases(node, walks.cost[parent] + cost + amounts[0], total, P, choices)
    return longer.only(np.flatnonzero((total <= problem.limits[:, None]).all(axis=0)))
