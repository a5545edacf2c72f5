"""Which sensors, when, for what a filter knows: the problem that every method works on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from obsdesign.selection.posterior.ceiling import ceilings
from obsdesign.selection.posterior.options import Options
from obsdesign.selection.posterior.segment_maps import SegmentMaps


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
    the covariance before the first samples.
    """

    maps: SegmentMaps
    options: Options
    P0: np.ndarray
    is_worst: bool

    @property
    def segments(self) -> int:
        """K."""
        return len(self.maps.instants)

    @cached_property
    def ceilings(self) -> np.ndarray:
        """Covariances (K, n, n) before each segment that no schedule is below."""
        return ceilings(self.maps, self.options, self.P0)

    def walk(self, nodes: np.ndarray) -> Walk:
        """Return a schedule with what it costs."""
        P, costs, covariances = self.P0[:, :, None], np.empty(len(nodes)), np.empty((len(nodes), *self.P0.shape))
        for k, node in enumerate(nodes):
            covariances[k] = P[:, :, 0]
            cost, P = self.maps.advance(k, self.options.pattern_of_node[[node]], P)
            costs[k] = cost[0]
        total = float(costs.max() if self.is_worst else costs.sum()) + self.switching(nodes)
        return Walk(nodes, total, costs, self.usage(nodes), covariances)

    def switching(self, nodes: np.ndarray) -> float:
        """Return what the switching-ons of a walk cost."""
        return float(self.options.switching_costs[_previous(nodes), nodes].sum())

    def usage(self, nodes: np.ndarray) -> np.ndarray:
        """Return how much of each resource a walk takes (R,)."""
        options, k = self.options, np.arange(len(nodes))
        return options.usage[:, k, nodes].sum(axis=1) + options.start_usage[:, _previous(nodes), nodes].sum(axis=1)

    def is_feasible(self, walk: Walk) -> bool:
        """Whether a walk keeps the limits of all resources."""
        return bool((walk.usage <= self.options.limits).all())

    def combine(self, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Return the cost of two stretches together."""
        return np.maximum(before, after) if self.is_worst else before + after


def _previous(nodes: np.ndarray) -> np.ndarray:
    """Return the node before each, -1 (nothing on) before the first."""
    return np.concatenate([[-1], nodes[:-1]])
