"""Limits between the nodes of a path: margins some seconds after a node, and how fast they change in time, inputs held."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from obsdesign.calculus import lie_derivative, rk4
from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.design.nlp.node_functions import moment_of
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.step import CACHED
from obsdesign.packing import packed, unpacked

_NOTHING, _EMPTY = np.empty((1, 0)), ca.SX(0, 1)
# cells of an interval at whose ends a margin is looked at, in so many rounds, about the best instants of so many intervals
_TRIED, _ROUNDS, _BASINS = 4, 3, 3
_NEWTON = 3  # steps from the best instant of the last round: near it each doubles the number of right digits
_LEVEL = 1e-4  # share of the square root of its curvature by which a margin may still rise where it is called largest


@dataclass(frozen=True, eq=False)
class Instants:
    """Margins (r,) at x(tau), tau seconds after a node (x, u) with u held, by one step of Runge-Kutta; derivatives to (x, u).

    at_node: the margins themselves, and their first and second derivatives in time, at the node.
    """

    x: ca.SX
    u: ca.SX
    tau: ca.SX
    then: ca.SX
    later: ca.SX
    at_node: tuple[ca.SX, ca.SX, ca.SX]

    def values(self, x: np.ndarray, u: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return (K, r) for x (K, n), u (K, m), tau (K,)."""
        return self._value.run(_NOTHING, [x, u, tau[:, None]], len(x), carries=False).results[0][0]

    def states(self, x: np.ndarray, u: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return x(tau) (K, n) for x (K, n), u (K, m), tau (K,)."""
        return self._state.run(_NOTHING, [x, u, tau[:, None]], len(x), carries=False).results[0][0]

    def slopes(self, x: np.ndarray, u: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return derivatives (K, r, n + m) to (x, u)."""
        found = self._slope.run(_NOTHING, [x, u, tau[:, None]], len(x), carries=False).results[0][0]
        return found.reshape(len(x), -1, x.shape[1] + u.shape[1])

    def bends(self, x: np.ndarray, u: np.ndarray, tau: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return gradient (K, v) and Hessian (K, v, v) of weights' values, weights (K, r)."""
        g, H = self._bend.run(_NOTHING, [x, u, tau[:, None], weights], len(x), carries=False).results
        return g[0], unpacked(H[0], g.shape[-1])

    def following(self, x: np.ndarray, u: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return (K, r, v, v): what a margin's second derivative to (x, u) gains where tau is always where the margin is largest.

        With tau* that of dm/dtau = 0: d2 m(v, tau*(v)) = m_vv - m_vtau m_tauv / m_tautau; 0 where m is not at its largest.
        """
        slope, bend, mixed = (each[0] for each in self._following.run(_NOTHING, [x, u, tau[:, None]], len(x), carries=False).results)
        mixed = mixed.reshape(*bend.shape, -1)
        largest = (bend < 0) & (np.abs(slope) < _LEVEL * np.sqrt(np.maximum(-bend, 0.0)))
        weight = np.where(largest, 1 / np.where(largest, -bend, 1.0), 0.0)
        return weight[..., None, None] * mixed[..., None] * mixed[..., None, :]

    def in_time(self, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return margins (K, r) at nodes, and their first and second derivatives in time with u held."""
        value, first, second = self._rates.run(_NOTHING, [x, u], len(x), carries=False).results
        return value[0], first[0], second[0]

    @cached_property
    def _value(self) -> Scan:
        return Scan(_EMPTY, [self.x, self.u, self.tau], _EMPTY, [self.later])

    @cached_property
    def _state(self) -> Scan:
        return Scan(_EMPTY, [self.x, self.u, self.tau], _EMPTY, [self.then])

    @cached_property
    def _slope(self) -> Scan:
        slope = ca.jacobian(self.later, ca.vertcat(self.x, self.u))
        return Scan(_EMPTY, [self.x, self.u, self.tau], _EMPTY, [ca.vec(ca.densify(slope).T)])

    @cached_property
    def _bend(self) -> Scan:
        weights = ca.SX.sym("weights", self.later.numel())
        H, g = ca.hessian(ca.dot(weights, self.later), ca.vertcat(self.x, self.u))
        return Scan(_EMPTY, [self.x, self.u, self.tau, weights], _EMPTY, [ca.densify(g), packed(ca.densify(H))])

    @cached_property
    def _following(self) -> Scan:
        slope = ca.jacobian(self.later, self.tau)
        bend, mixed = ca.jacobian(slope, self.tau), ca.jacobian(slope, ca.vertcat(self.x, self.u))
        return Scan(_EMPTY, [self.x, self.u, self.tau], _EMPTY, [ca.densify(slope), ca.densify(bend), ca.vec(ca.densify(mixed).T)])

    @cached_property
    def _rates(self) -> Scan:
        return Scan(_EMPTY, [self.x, self.u], _EMPTY, list(self.at_node))


@lru_cache(CACHED)
def instants_of(model: Model, constraints: tuple[AbstractConstraint, ...]) -> Instants:
    """Return the functions of a model's constraints."""
    moment, tau = moment_of(model), ca.SX.sym("tau")
    parts = [ca.SX(margin) for constraint in constraints for margin in constraint.margins(moment)]
    column, drift = ca.vertcat(*parts) if parts else ca.SX(0, 1), model.drift + model.B @ model.u
    rate, margins = ca.Function("rate", [model.x, model.u], [drift]), ca.Function("margins", [model.x, model.u], [column])
    then = rk4(lambda x: ca.SX(rate(x, model.u)), model.x, tau)  # a symbol serves as well
    first = lie_derivative(column, model.x, drift)
    second = lie_derivative(first, model.x, drift)
    return Instants(model.x, model.u, tau, then, ca.SX(margins(then, model.u)), (column, first, second))


@dataclass(frozen=True, eq=False)
class Intervals:
    """I stretches of a path with inputs held: x (I, n) where each begins, u (I, m), and from `low` to `high` (I,) seconds after it."""

    x: np.ndarray
    u: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def only(self, chosen: np.ndarray) -> Intervals:
        """Return some of them."""
        return Intervals(self.x[chosen], self.u[chosen], self.low[chosen], self.high[chosen])


def stretches(t: np.ndarray, length: float, first: float, last: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which intervals of so many seconds from t (I,) on [first, last] meets, and from when to when in each [s]: (K,) each."""
    low, high = np.clip(first - t, 0.0, length), np.clip(last - t, 0.0, length)
    slack = 1e-9 * length
    within = np.flatnonzero((last - t >= -slack) & (first - t <= length + slack))
    return within, np.minimum(low, high)[within], high[within]


def best_instant(instants: Instants, every: Intervals, mine: np.ndarray) -> tuple[int, float, float]:
    """Return the interval, the seconds after its beginning, and the value at which the least of the margins `mine` is largest.

    Looked for on ever finer grids about the best instants, then by Newton's method.
    """
    chosen, low, width = np.arange(len(every.low)), every.low, every.high - every.low
    best = (0, float(every.high[0]), -np.inf)
    for _ in range(_ROUNDS):
        tau = low[:, None] + width[:, None] * np.linspace(0, 1, _TRIED + 1)
        values = _least(instants, every, chosen, tau, mine)
        at, place = np.unravel_index(int(values.argmax()), values.shape)
        best = max(best, (int(chosen[at]), float(tau[at, place]), float(values[at, place])), key=_value)
        kept = np.argsort(-values.max(axis=1), kind="stable")[:_BASINS]
        cell, centre = width[kept] / _TRIED, tau[kept, values[kept].argmax(axis=1)]
        chosen = chosen[kept]
        low = np.maximum(centre - cell, every.low[chosen])
        width = np.minimum(centre + cell, every.high[chosen]) - low
    return _polished(instants, every, best, mine)


def _polished(instants: Instants, every: Intervals, best: tuple[int, float, float], mine: np.ndarray) -> tuple[int, float, float]:
    """The same after Newton's steps on the margin that is least, to where its slope in time is 0."""
    i, tau, _ = best
    for _ in range(_NEWTON):
        x = instants.states(every.x[[i]], every.u[[i]], np.array([tau]))
        value, slope, bend = (each[0, mine] for each in instants.in_time(x, every.u[[i]]))
        j = int(value.argmin())
        if not bend[j] < 0:
            break
        tau = float(np.clip(tau - slope[j] / bend[j], every.low[i], every.high[i]))
    value = float(_least(instants, every, np.array([i]), np.array([[tau]]), mine)[0, 0])
    return max((i, tau, value), best, key=_value)


def _value(found: tuple[int, float, float]) -> float:
    return found[2]


def _least(instants: Instants, every: Intervals, chosen: np.ndarray, tau: np.ndarray, mine: np.ndarray) -> np.ndarray:
    """The least of the margins `mine` (K, T) at instants tau (K, T) of the chosen intervals."""
    count = tau.shape[1]
    x, u = np.repeat(every.x[chosen], count, axis=0), np.repeat(every.u[chosen], count, axis=0)
    return instants.values(x, u, tau.ravel())[:, mine].min(axis=1).reshape(tau.shape)
