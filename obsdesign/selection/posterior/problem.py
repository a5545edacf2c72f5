"""Which sensors, when, for what a filter knows: the problem that every method works on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from obsdesign.selection.posterior.ceiling import ceilings
from obsdesign.selection.posterior.deadline import NEVER, Deadline
from obsdesign.selection.posterior.options import Options
from obsdesign.selection.posterior.segment_maps import SegmentMaps

_FULL_STEP = 250.0  # `step_size` up to which a search may take all of its steps


@dataclass(frozen=True, eq=False)
class Purchase:
    """Where schedules are paid for: what a node costs in a segment (K, A), and limits (I,) of what the maps add up."""

    on_costs: np.ndarray
    limits: np.ndarray


@dataclass(frozen=True, eq=False)
class Walk:
    """A schedule as nodes (K,) with what it costs: value, cost (K,) of each segment, usage (R,), covariances (K, n, n) before segments."""

    nodes: np.ndarray
    value: float
    costs: np.ndarray
    usage: np.ndarray
    covariances: np.ndarray


@dataclass(frozen=True, eq=False)
class PosteriorProblem:
    """min cost(schedule) over the walks through `options` within their resources.

    cost: the sum of the segments' costs, or the largest where is_worst, plus what switching costs. maps: one per segment; P0 (n, n):
    the covariance before the first samples. purchase: None, or nodes cost what it says, and what the maps add up is limited as resources
    are. A stretch of a run is a problem of its own, with ceilings of the run: no schedule of the
    run costs less in the stretch than the best of its own, begun at the ceiling with any choice. Methods stop soon after the deadline.
    """

    maps: SegmentMaps
    options: Options
    P0: np.ndarray
    is_worst: bool
    purchase: Purchase | None = None
    known_ceilings: np.ndarray | None = None
    deadline: Deadline = NEVER

    @property
    def segments(self) -> int:
        """K."""
        return len(self.maps.instants)

    @property
    def step_size(self) -> float:
        """How many numbers a step through a segment works on, about: n^2, once more for every eight samples."""
        T, R, n, _ = self.maps.rows.shape
        return n**2 * (1 + T * R / 8)

    @property
    def step_share(self) -> float:
        """Share of the steps of a search that it may take: all up to a `step_size` of 250, fewer of larger ones."""
        return min(1.0, _FULL_STEP / self.step_size)

    @cached_property
    def ceilings(self) -> np.ndarray:
        """Covariances (K, n, n) before each segment that no schedule is below."""
        return ceilings(self.maps, self.options, self.P0, self.deadline) if self.known_ceilings is None else self.known_ceilings

    def stretch(self, first: int, weights: np.ndarray) -> PosteriorProblem:
        """Return the problem of segments from one on, which count as much as weights (k,) say; limits in sum are left out."""
        options, last = self.options, first + len(weights)
        may_start = np.ones_like(options.may_start) if first else options.may_start
        options = replace(options, allowed=options.allowed[first:last], may_start=may_start, resources=())
        P0 = self.ceilings[first]
        maps, known = self.maps.stretch(first, weights), self.ceilings[first:last]
        return PosteriorProblem(maps, options, P0, self.is_worst, known_ceilings=known, deadline=self.deadline)

    @property
    def limits(self) -> np.ndarray:
        """Limits (R,) of everything that is limited in sum, with what rounding may add to it."""
        return self.options.limits if self.purchase is None else np.concatenate([self.options.limits, self.purchase.limits + 1e-9])

    def advance(
        self, k: np.ndarray | int, before: np.ndarray, node: np.ndarray, P: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what steps (B,) into segments cost, what they cost for switching and take of what is limited (R + 1, B), and P after."""
        options = self.options
        measured, P_next = self.maps.advance(k, options.pattern_of_node[node], P)
        usage = options.usage[:, k, node] + options.start_usage[:, before, node]
        amounts = np.vstack([self.switching_costs(k, before, node), usage])
        if self.purchase is None:
            return measured, amounts, P_next
        return self.purchase.on_costs[k, node], np.vstack([amounts, measured]), P_next

    def walk(self, nodes: np.ndarray) -> Walk:
        """Return a schedule with what it costs."""
        return self.walks([nodes])[0]

    def walks(self, schedules: Sequence[np.ndarray]) -> list[Walk]:
        """Return schedules with what they cost, all looked at at once."""
        if not len(schedules):
            return []
        nodes = np.array(schedules)
        P, costs = np.repeat(self.P0[:, :, None], len(nodes), axis=2), np.empty(nodes.shape)
        covariances, amounts = np.empty((*nodes.shape, *self.P0.shape)), np.zeros((len(self.limits) + 1, len(nodes)))
        before = np.full(len(nodes), -1)
        for k, node in enumerate(nodes.T):
            covariances[:, k] = P.transpose(2, 0, 1)
            costs[:, k], taken, P = self.advance(k, before, node, P)
            amounts, before = amounts + taken, node
        totals = [self.total(own) + float(extra) for own, extra in zip(costs, amounts[0], strict=True)]
        return [Walk(nodes[b], totals[b], costs[b], amounts[1:, b], covariances[b]) for b in range(len(nodes))]

    def amounts(self, nodes: np.ndarray) -> np.ndarray:
        """Return what a walk (K,) pays for switching and takes of each resource (R + 1,), what maps add up left out."""
        k, before = np.arange(len(nodes)), previous_nodes(nodes)
        usage = self.options.usage[:, k, nodes] + self.options.start_usage[:, before, nodes]
        return np.append(self.switching(nodes), usage.sum(axis=1))

    def switching(self, nodes: np.ndarray) -> float:
        """Return what the switching-ons of a walk cost."""
        return float(self.switching_costs(np.arange(len(nodes)), previous_nodes(nodes), nodes).sum())

    def switching_costs(self, k: np.ndarray | int, before: np.ndarray, node: np.ndarray) -> np.ndarray:
        """Return what steps (B,) into segments cost for switching; nothing where a stretch of a run does not count yet."""
        weight = 1.0 if self.maps.weights is None else self.maps.weights[k] * ((k > 0) | (self.maps.first == 0))
        return weight * self.options.switching_costs[before, node]

    def is_feasible(self, walk: Walk) -> bool:
        """Whether a walk keeps the limits of all resources."""
        return bool((walk.usage <= self.limits).all())

    def total(self, costs: np.ndarray) -> float:
        """Return the cost of stretches with costs (k,), one at least, together."""
        return float(costs.max() if self.is_worst else costs.sum())

    def combine(self, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Return the cost of two stretches together."""
        return np.maximum(before, after) if self.is_worst else before + after


def previous_nodes(nodes: np.ndarray) -> np.ndarray:
    """Return the node before each, -1 (what was on) before the first."""
    return np.concatenate([[-1], nodes[:-1]])
