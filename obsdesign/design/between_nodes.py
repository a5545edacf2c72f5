"""What the limits of a path are between the nodes: least margins, with the error of finding them far below what is claimed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

import numpy as np

from obsdesign.constraints.abstract import Span
from obsdesign.design.nlp.margin_curves import Intervals, MarginCurves, best_instant, intersect_intervals, margin_curves_of
from obsdesign.design.nlp.node_functions import NodeFunctions, node_functions_of
from obsdesign.design.path_costs import REFINEMENT, refine_path
from obsdesign.design.problem import DesignProblem
from obsdesign.design.quintic import minimise_quintic
from obsdesign.dynamics.simulation import substeps_along
from obsdesign.trajectory import Trajectory

_MAX_REFINEMENT = 160  # steps of the check for one step of the path at most
_INTEGRATION_TOLERANCE = 1e-8  # what integration may add to a margin of order 1
_COARSE_TOLERANCE = (
    1e-5  # a path whose margins differ by less from those of steps a tenth as long, 10^4 times as exact, needs no finer ones
)
_INTERPOLATION_TOLERANCE = 1e-6  # by how much polynomials of third and fifth degree may differ before an interval is halved
_NEAR_MARGIN = 1e-2  # lower bounds of margins below this are looked into
_HALVINGS = 12  # of an interval of time at most: after 4096 parts the least value is taken as it is


@dataclass(frozen=True, eq=False)
class MarginMinimum:
    """A local minimum of a margin: of which, when [s], its value; before_jump: just before that time, under the inputs until then."""

    margin: int
    time: float
    value: float
    before_jump: bool = False


@dataclass(frozen=True, eq=False)
class FinePath:
    """A path integrated finely: t (F+1,), x (F+1, n), u (F, m) held from each instant to the next."""

    curves: MarginCurves
    nodes: NodeFunctions
    t: np.ndarray
    x: np.ndarray
    u: np.ndarray

    @property
    def h(self) -> float:
        """Seconds between two instants."""
        return float(self.t[1] - self.t[0])

    @cached_property
    def owner(self) -> np.ndarray:
        """Index of the constraint of every margin (r,)."""
        return np.array(self.nodes.owner, dtype=int)

    @property
    def margins(self) -> np.ndarray:
        """Margins (F+1, r) at the instants."""
        begin, end = self.ends
        return np.vstack([begin, end[-1:]])

    @cached_property
    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Margins (F, r) where each interval begins and where it ends, the inputs those that are held over it."""
        values = self.nodes.values(self.x, np.vstack([self.u, self.u[-1:]]))
        begin, end = values[:-1], values[1:]
        if any(self.nodes.of_inputs) and len(jumps := np.flatnonzero(np.any(self.u[1:] != self.u[:-1], axis=1))):
            end = end.copy()
            end[jumps] = self.nodes.values(self.x[jumps + 1], self.u[jumps])
        return begin, end

    def at_nodes(self, finer: int) -> np.ndarray:
        """Margins (N+1, r) at every so manyth instant."""
        return self.margins[::finer]

    @cached_property
    def change(self) -> np.ndarray:
        """The most that each margin changes by over an interval (r,)."""
        begin, end = self.ends
        return np.abs(end - begin).max(axis=0)

    def minima_of(self, constraint_index: int, span: Span) -> list[MarginMinimum]:
        """Return the local minima of a constraint's margins within its span, least first; of what must hold once, the best instant."""
        margin_indices = np.flatnonzero(self.owner == constraint_index)
        if not len(margin_indices):
            return []
        if span.anywhere:
            return [self.best_instant(margin_indices, span)]
        return sorted(self.minima(margin_indices, span), key=attrgetter("value"))

    def minima(self, margin_indices: np.ndarray, span: Span) -> list[MarginMinimum]:
        """Return the local minima of each of the margins `margin_indices` that are near 0 or below within a span.

        Only intervals are looked into at whose ends a margin is not above 0.01 by the most that it changes by over any interval: in
        between it cannot fall by more than about half of that. There it is the polynomial of fifth degree through values, slopes and
        curvatures at both ends, which differs from that of third degree by far more than from the margin itself: intervals are halved
        until these two agree to 1e-6.
        """
        intervals, low, high = intersect_intervals(self.t[:-1], self.h, *self._time_window(span))
        lowest = np.minimum(*(side[intervals][:, margin_indices] for side in self.ends))
        if not np.isfinite(lowest).all():
            interval, which = np.argwhere(~np.isfinite(lowest))[0]
            return [MarginMinimum(int(margin_indices[which]), float(self.t[intervals[interval]]), np.nan)]
        which, interval = np.nonzero((lowest < _NEAR_MARGIN + self.change[margin_indices]).T)
        if not len(which):
            return []
        interval_indices, margin = intervals[interval], margin_indices[which]
        tau, value = self._minimise(interval_indices, margin, low[interval], high[interval])
        at_end = tau >= self.h * (1 - 1e-9)
        return [
            MarginMinimum(int(margin[k]), float(self.t[interval_indices[k]] + tau[k]), float(value[k]), bool(at_end[k]))
            for k in _local_minima(interval_indices + which * (len(self.t) + 1), value)
        ]

    def best_instant(self, margin_indices: np.ndarray, span: Span) -> MarginMinimum:
        """Return when, within a span, the least of the margins `margin_indices` is largest."""
        intervals, low, high = intersect_intervals(self.t[:-1], self.h, *self._time_window(span))
        i, tau, value = best_instant(self.curves, Intervals(self.x[intervals], self.u[intervals], low, high), margin_indices)
        return MarginMinimum(int(margin_indices[0]), float(self.t[intervals[i]] + tau), value)

    def _time_window(self, span: Span) -> tuple[float, float]:
        first, last = (self.t[-1] if time is None else min(time, self.t[-1]) for time in (span.first, span.last))
        return float(first), float(last)

    def _minimise(self, which: np.ndarray, margin: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """When (seconds after they begin) margins (K,) are least in intervals (K,), each from low to high, and what they are then."""
        every, place = np.unique(which, return_inverse=True)
        u = self.u[every]
        sides = np.array([self.curves.time_derivatives(self.x[every + after], u) for after in (0, 1)])
        begin, end = sides[:, :, place, margin]
        share, value, error = minimise_quintic(begin, end, np.full(len(which), self.h), low / self.h, high / self.h)
        tau = share * self.h
        for k in np.flatnonzero((error > _INTERPOLATION_TOLERANCE) & (value - error < _NEAR_MARGIN)):
            tau[k], value[k] = self._minimise_by_halving(int(which[k]), int(margin[k]), float(low[k]), float(high[k]))
        return tau, value

    def _minimise_by_halving(self, i: int, j: int, low: float, high: float) -> tuple[float, float]:
        """The same for one interval, cut into ever shorter ones."""
        for halvings in range(1, _HALVINGS + 1):
            tau, value, is_accurate = self._minimise_on_grid(i, j, np.linspace(low, high, 2**halvings + 1))
            if is_accurate:
                break
        return tau, value  # pyright: ignore[reportPossiblyUnboundVariable]  # there is a halving

    def _minimise_on_grid(self, i: int, j: int, taus: np.ndarray) -> tuple[float, float, bool]:
        """When a margin is least between instants taus after interval i begins, what it is, and whether finer ones say the same."""
        x, u = np.repeat(self.x[[i]], len(taus), axis=0), np.repeat(self.u[[i]], len(taus), axis=0)
        derivatives = np.array(self.curves.time_derivatives(self.curves.states(x, u, taus), u))[:, :, j]
        width = float(taus[1] - taus[0])
        count = len(taus) - 1
        share, value, error = minimise_quintic(
            derivatives[:, :-1], derivatives[:, 1:], np.full(count, width), np.zeros(count), np.ones(count)
        )
        k = int(value.argmin())
        return (
            float(taus[k] + share[k] * width),
            float(value[k]),
            not ((error > _INTERPOLATION_TOLERANCE) & (value - error < value[k])).any(),
        )


def fine_path(problem: DesignProblem, path: Trajectory) -> FinePath:
    """Return a path integrated ten times as finely, or finer, until its margins at the nodes are exact to 1e-8 by Richardson's rule.

    Never more coarsely than the path itself: what its sub-steps are too long for is not smooth between the instants either.
    """
    refinement = max(REFINEMENT, substeps_along(problem.system, path))
    fine = _integrate_finely(problem, path, refinement)
    nominal = fine.nodes.values(path.x, np.vstack([path.u, path.u[-1:]]))
    if _margin_difference(nominal, nominal, fine.at_nodes(refinement)) <= _COARSE_TOLERANCE:
        return fine
    coarse = _integrate_finely(problem, path, refinement // 2).at_nodes(refinement // 2)
    while _margin_difference(nominal, coarse, fine.at_nodes(refinement)) > 15 * _INTEGRATION_TOLERANCE and refinement < _MAX_REFINEMENT:
        coarse, refinement = fine.at_nodes(refinement), 2 * refinement
        fine = _integrate_finely(problem, path, refinement)
    return fine


def _integrate_finely(problem: DesignProblem, path: Trajectory, refinement: int) -> FinePath:
    model = problem.system.model
    step, x, u = refine_path(problem.system, path, refinement)
    return FinePath(
        margin_curves_of(model, problem.constraints), node_functions_of(model, problem.constraints), np.arange(len(x)) * step, x, u
    )


def _margin_difference(nominal: np.ndarray, first_states: np.ndarray, second_states: np.ndarray) -> float:
    """By how much margins (N+1, r) of two sets of states differ, where those of the path are near 0."""
    return float(np.abs(first_states - second_states)[nominal < 1.0].max(initial=0.0))


def _local_minima(which: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Return where the least values (K,) of intervals, which (K,) are their numbers in rising order, have local minima."""
    before, after = np.full(len(which), np.inf), np.full(len(which), np.inf)
    follows = np.flatnonzero(np.diff(which) == 1)
    before[follows + 1], after[follows] = value[follows], value[follows + 1]
    return np.flatnonzero((value <= before) & (value < after) | (value < before) & (value <= after))
