"""Limits between the nodes of a path: margins some seconds after a node, and how fast they change in time, inputs held."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from obsdesign.calculus import lie_derivative, rk4
from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.design.nlp.node_functions import moment_of, rate_within_steps
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.step import CACHE_SIZE
from obsdesign.packing import pack, unpack

_NOTHING, _EMPTY = np.empty((1, 0)), ca.SX(0, 1)
# cells of an interval at whose ends a margin is looked at, in so many rounds, about the best instants of so many intervals
_CELLS, _ROUNDS, _BASINS = 4, 3, 3
_NEWTON_STEPS = 3  # steps from the best instant of the last round: near it each doubles the number of right digits
_STATIONARY_SHARE = 1e-4  # share of the square root of its curvature by which a margin may still rise where it is called largest


@dataclass(frozen=True, eq=False)
class MarginCurves:
    """Margins (r,) at x(tau), tau seconds after a node (x, u) with u held, by one step of Runge-Kutta; derivatives to (x, u).

    at_node: the margins themselves, and their first and second derivatives in time, at the node.
    """

    x: ca.SX
    u: ca.SX
    tau: ca.SX
    x_tau: ca.SX
    margins_tau: ca.SX
    at_node: tuple[ca.SX, ca.SX, ca.SX]

    def values(self, x: np.ndarray, u: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return (K, r) for x (K, n), u (K, m), tau (K,)."""
        return self._margin_scan.run(_NOTHING, [x, u, tau[:, None]], len(x), carries=False).results[0][0]

    def states(self, x: np.ndarray, u: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return x(tau) (K, n) for x (K, n), u (K, m), tau (K,)."""
        return self._state_scan.run(_NOTHING, [x, u, tau[:, None]], len(x), carries=False).results[0][0]

    def gradients(self, x: np.ndarray, u: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return derivatives (K, r, n + m) to (x, u)."""
        gradients = self._gradient_scan.run(_NOTHING, [x, u, tau[:, None]], len(x), carries=False).results[0][0]
        return gradients.reshape(len(x), -1, x.shape[1] + u.shape[1])

    def hessians(self, x: np.ndarray, u: np.ndarray, tau: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return gradient (K, v) and Hessian (K, v, v) of weights' values, weights (K, r)."""
        g, H = self._hessian_scan.run(_NOTHING, [x, u, tau[:, None], weights], len(x), carries=False).results
        return g[0], unpack(H[0], g.shape[-1])

    def best_instant_hessians(self, x: np.ndarray, u: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return (K, r, v, v): what a margin's second derivative to (x, u) gains where tau is always where the margin is largest.

        With tau* that of dm/dtau = 0: d2 m(v, tau*(v)) = m_vv - m_vtau m_tauv / m_tautau; 0 where m is not at its largest.
        """
        rate, second_rate, cross = (
            output[0] for output in self._best_instant_scan.run(_NOTHING, [x, u, tau[:, None]], len(x), carries=False).results
        )
        cross = cross.reshape(*second_rate.shape, -1)
        largest = (second_rate < 0) & (np.abs(rate) < _STATIONARY_SHARE * np.sqrt(np.maximum(-second_rate, 0.0)))
        weight = np.where(largest, 1 / np.where(largest, -second_rate, 1.0), 0.0)
        return weight[..., None, None] * cross[..., None] * cross[..., None, :]

    def time_derivatives(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return margins (K, r) at nodes, and their first and second derivatives in time with u held."""
        value, first, second = self._time_derivative_scan.run(_NOTHING, [x, u], len(x), carries=False).results
        return value[0], first[0], second[0]

    @cached_property
    def _margin_scan(self) -> Scan:
        return Scan(_EMPTY, [self.x, self.u, self.tau], _EMPTY, [self.margins_tau])

    @cached_property
    def _state_scan(self) -> Scan:
        return Scan(_EMPTY, [self.x, self.u, self.tau], _EMPTY, [self.x_tau])

    @cached_property
    def _gradient_scan(self) -> Scan:
        gradient = ca.jacobian(self.margins_tau, ca.vertcat(self.x, self.u))
        return Scan(_EMPTY, [self.x, self.u, self.tau], _EMPTY, [ca.vec(ca.densify(gradient).T)])

    @cached_property
    def _hessian_scan(self) -> Scan:
        weights = ca.SX.sym("weights", self.margins_tau.numel())
        H, g = ca.hessian(ca.dot(weights, self.margins_tau), ca.vertcat(self.x, self.u))
        return Scan(_EMPTY, [self.x, self.u, self.tau, weights], _EMPTY, [ca.densify(g), pack(ca.densify(H))])

    @cached_property
    def _best_instant_scan(self) -> Scan:
        rate = ca.jacobian(self.margins_tau, self.tau)
        second_rate, cross = ca.jacobian(rate, self.tau), ca.jacobian(rate, ca.vertcat(self.x, self.u))
        return Scan(_EMPTY, [self.x, self.u, self.tau], _EMPTY, [ca.densify(rate), ca.densify(second_rate), ca.vec(ca.densify(cross).T)])

    @cached_property
    def _time_derivative_scan(self) -> Scan:
        return Scan(_EMPTY, [self.x, self.u], _EMPTY, list(self.at_node))


@lru_cache(CACHE_SIZE)
def margin_curves_of(model: Model, constraints: tuple[AbstractConstraint, ...]) -> MarginCurves:
    """Return the functions of a model's constraints."""
    instant, tau = moment_of(model), ca.SX.sym("tau")
    parts = [ca.SX(margin) for constraint in constraints for margin in constraint.margins(instant)]
    column, drift = ca.vertcat(*parts) if parts else ca.SX(0, 1), rate_within_steps(model)
    rate, margins = ca.Function("rate", [model.x, model.u], [drift]), ca.Function("margins", [model.x, model.u], [column])
    x_tau = rk4(lambda x: ca.SX(rate(x, model.u)), model.x, tau)  # a symbol serves as well
    first = lie_derivative(column, model.x, drift)
    second = lie_derivative(first, model.x, drift)
    return MarginCurves(model.x, model.u, tau, x_tau, ca.SX(margins(x_tau, model.u)), (column, first, second))


@dataclass(frozen=True, eq=False)
class Intervals:
    """I stretches of a path with inputs held: x (I, n) where each begins, u (I, m), and from `low` to `high` (I,) seconds after it."""

    x: np.ndarray
    u: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def select(self, chosen: np.ndarray) -> Intervals:
        """Return some of them."""
        return Intervals(self.x[chosen], self.u[chosen], self.low[chosen], self.high[chosen])


def intersect_intervals(t: np.ndarray, length: float, first: float, last: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which intervals of so many seconds from t (I,) on [first, last] meets, and from when to when in each [s]: (K,) each."""
    low, high = np.clip(first - t, 0.0, length), np.clip(last - t, 0.0, length)
    slack = 1e-9 * length
    within = np.flatnonzero((last - t >= -slack) & (first - t <= length + slack))
    return within, np.minimum(low, high)[within], high[within]


def best_instant(curves: MarginCurves, intervals: Intervals, margin_indices: np.ndarray) -> tuple[int, float, float]:
    """Return the interval, the seconds after its beginning, and the value at which the least of the margins `margin_indices` is largest.

    Looked for on ever finer grids about the best instants, then by Newton's method.
    """
    chosen, low, width = np.arange(len(intervals.low)), intervals.low, intervals.high - intervals.low
    best = (0, float(intervals.high[0]), -np.inf)
    for _ in range(_ROUNDS):
        tau = low[:, None] + width[:, None] * np.linspace(0, 1, _CELLS + 1)
        values = _lowest_margin(curves, intervals, chosen, tau, margin_indices)
        row, column = np.unravel_index(int(values.argmax()), values.shape)
        best = max(best, (int(chosen[row]), float(tau[row, column]), float(values[row, column])), key=_candidate_value)
        leading = np.argsort(-values.max(axis=1), kind="stable")[:_BASINS]
        cell, centre = width[leading] / _CELLS, tau[leading, values[leading].argmax(axis=1)]
        chosen = chosen[leading]
        low = np.maximum(centre - cell, intervals.low[chosen])
        width = np.minimum(centre + cell, intervals.high[chosen]) - low
    return _newton_polish(curves, intervals, best, margin_indices)


def _newton_polish(
    curves: MarginCurves, intervals: Intervals, best: tuple[int, float, float], margin_indices: np.ndarray
) -> tuple[int, float, float]:
    """The same after Newton's steps on the margin that is least, to where its slope in time is 0."""
    i, tau, _ = best
    for _ in range(_NEWTON_STEPS):
        x = curves.states(intervals.x[[i]], intervals.u[[i]], np.array([tau]))
        value, rate, second_rate = (output[0, margin_indices] for output in curves.time_derivatives(x, intervals.u[[i]]))
        j = int(value.argmin())
        if not second_rate[j] < 0:
            break
        tau = float(np.clip(tau - rate[j] / second_rate[j], intervals.low[i], intervals.high[i]))
    value = float(_lowest_margin(curves, intervals, np.array([i]), np.array([[tau]]), margin_indices)[0, 0])
    return max((i, tau, value), best, key=_candidate_value)


def _candidate_value(candidate: tuple[int, float, float]) -> float:
    return candidate[2]


def _lowest_margin(
    curves: MarginCurves, intervals: Intervals, chosen: np.ndarray, tau: np.ndarray, margin_indices: np.ndarray
) -> np.ndarray:
    """The least of the margins `margin_indices` (K, T) at instants tau (K, T) of the chosen intervals."""
    count = tau.shape[1]
    x, u = np.repeat(intervals.x[chosen], count, axis=0), np.repeat(intervals.u[chosen], count, axis=0)
    return curves.values(x, u, tau.ravel())[:, margin_indices].min(axis=1).reshape(tau.shape)
