"""A design problem as functions of the path's parameters: matrices to be large, margins to be positive, and their derivatives."""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from obsdesign.criteria.abstract import Knowledge
from obsdesign.design.nlp.abstract import AbstractProgram
from obsdesign.design.nlp.constraint_rows import placed
from obsdesign.design.nlp.evaluation import NO_ROWS, Multipliers, Rows, Slopes, Values
from obsdesign.design.nlp.information_recursion import bare_recursion, gramian_recursion, posterior_recursion
from obsdesign.design.nlp.input_map import inputs_of
from obsdesign.design.nlp.margin_curves import Instants, instants_of
from obsdesign.design.nlp.node_functions import Nodes, nodes_of
from obsdesign.design.nlp.rollout import Along, Injected, Linear, Variation, carried
from obsdesign.design.problem import DesignProblem
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.step import CACHED
from obsdesign.information.additive_amounts import counting
from obsdesign.information.correlated_noise import colour_of
from obsdesign.information.sample_information import sampled
from obsdesign.packing import lower_indices, unpacked


class Program(AbstractProgram):
    """The functions of one problem with one duration. Nothing changes after construction.

    segments: where errors are not independent, count the amounts that `segment_information` has for so many segments, linear in
    the weights, instead of all that the samples say together. judged: otherwise no information is carried along the path, its
    matrix is 0 and limits alone count; not with a floor.
    """

    def __init__(self, problem: DesignProblem, rows: Rows | None = None, segments: int | None = None, judged: bool = True) -> None:
        self.problem, model = problem, problem.system.model
        self.n, self.m, self.steps = len(model.states), len(model.inputs), problem.steps
        self._is_judged = judged or problem.floor is not None
        known, step, pace = problem.criterion.knowledge if self._is_judged else None, problem.step, (problem.step, problem.substeps)
        self._variation = _variation_of(model, pace, known, segments is not None) if self._is_judged else _bare_variation_of(model, pace)
        self._due = sampled(problem.system, self.steps, step).astype(float)
        self._sensors, aside = self._due.shape[1], _beside(model, self._due, known, segments)
        if problem.weights is not None:
            self._due = self.due(np.asarray(problem.weights))
        self._due = np.hstack([self._due, *(aside if self._is_judged else ())])
        self.lower, self.upper = problem.path.box(problem.grid)
        self._inputs = inputs_of(problem.path, problem.grid)
        costs = tuple(term.cost for term in (*problem.prices, *problem.budgets))
        self._nodes: Nodes | None = nodes_of(model, problem.constraints, costs, pace) if problem.constraints or costs else None
        self.rows = NO_ROWS if rows is None else rows
        # the path itself comes first; draws of the prior, where there are any, are judged in its place
        robust = problem.robust if self._is_judged else None
        draws = [] if robust is None else [robust.draws(robust.samples, 0)]
        self._starts = np.vstack([problem.x0[None], *draws])
        self.judged = slice(0 if robust is None else 1, len(self._starts))
        self._frame = np.outer(problem.units, problem.units)
        self._most = np.array([budget.at_most for budget in problem.budgets])
        self._per_unit = np.array([price.per_unit for price in problem.prices])

    @cached_property
    def _instants(self) -> Instants:
        return instants_of(self.problem.system.model, self.problem.constraints)

    @property
    def q(self) -> int:
        """Number of parameters."""
        return len(self.lower)

    def inputs(self, p: np.ndarray) -> np.ndarray:
        """Return u (N, m)."""
        if self._inputs.is_linear:
            offset, slope = self._inputs.line
            return (offset + slope @ p).reshape(self.steps, self.m)
        return self._inputs.value(p).full().reshape(self.steps, self.m)

    def due(self, weights: np.ndarray) -> np.ndarray:
        """Return how much each sensor's sample counts at each step (N, S) for weights (K, S) of K equal groups of steps."""
        each, S = np.repeat(weights, self.steps // len(weights), axis=0), self._sensors
        return np.hstack([self._due[:, :S] * each, self._due[:, S:]]) if self._due.shape[1] > S else self._due * each

    # ---------------------------------------------------------------- values

    def at(self, p: np.ndarray, due: np.ndarray | None = None) -> Values:
        """Return the values at p (q,); due (N, S): what samples count for instead."""
        u = self.inputs(p)
        along, sums = self._variation.along(self._starts, u, self._due if due is None else due)
        windows, floors = self._windows(along, u)
        totals = self._node_values(along)
        price = float(self._per_unit @ totals[1][: len(self._per_unit)])
        budgets = 1 - totals[1][len(self._per_unit) :] / self._most
        place = placed(self.problem, self.rows, along.z[0, :, : self.n], along.u[0], totals[0])
        rows = np.concatenate([place.values - self.rows.allowance, budgets, self._rate_rows(p)[0]])
        matrices = self.problem.counted(unpacked(sums[self.judged], self.n)) if self._is_judged else np.zeros((1, self.n, self.n))
        return Values(p, along, windows, matrices, floors, rows, price, place.node, place.after)

    def margins(self, values: Values) -> np.ndarray:
        """Return all margins (N+1, r) of the constraints at all nodes."""
        return self._node_values(values.along)[0]

    def _node_values(self, along: Along) -> tuple[np.ndarray, np.ndarray]:
        """Margins (N+1, r) at the nodes, and the sums of the costs."""
        if self._nodes is None:
            return np.zeros((self.steps + 1, 0)), np.zeros(0)
        values = self._nodes.values(*self._places(along))
        count = self._nodes.margins
        return values[:, :count], values[:-1, count:].sum(axis=0) * self.problem.step

    def _places(self, along: Along) -> tuple[np.ndarray, np.ndarray]:
        """(x, u) at all nodes of the path itself; the last inputs count for the end as well."""
        return along.z[0, :, : self.n], np.vstack([along.u[0], along.u[0, -1:]])

    def _rate_rows(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """1 -+ rate / limit for each rate of change, and the derivatives (., q)."""
        limits = self.problem.rates
        if not limits:
            return np.zeros(0), np.zeros((0, self.q))
        values, slopes = (each.full() for each in self._inputs.rates(p))
        count = len(values) // self.m
        kept = [i * count + j for i, name in enumerate(self.problem.system.model.input_names) if name in limits for j in range(count)]
        limit = np.repeat([limits[name] for name in self.problem.system.model.input_names if name in limits], count)
        rate, slope = values.ravel()[kept] / limit, slopes[kept] / limit[:, None]
        return np.concatenate([1 - rate, 1 + rate]), np.vstack([-slope, slope])

    # ---------------------------------------------------------------- first derivatives

    def slopes(self, values: Values) -> Slopes:
        """Return the first derivatives where the values were taken."""
        M = self._slope_of_inputs(values.p)
        linear = self._variation.linear(values.along)
        first = np.zeros((len(self._starts), self._variation.c, self.q))
        G = carried(linear, first, M)
        matrices = self._summed(linear, G)[self.judged]
        windows, floors = self._window_slopes(values, G, M)
        rows, price = self._node_slopes(values, G, M)
        rates = self._rate_rows(values.p)[1]
        return Slopes(matrices, floors, np.vstack([rows, rates]), price, M, G, windows)

    def _slope_of_inputs(self, p: np.ndarray) -> np.ndarray:
        if self._inputs.is_linear:
            return self._inputs.line[1].reshape(self.steps, self.m, self.q)
        return self._inputs.slope(p).full().reshape(self.steps, self.m, self.q)

    def _summed(self, linear: Linear, G: np.ndarray) -> np.ndarray:
        """Derivatives (M, q, n, n) of S W S, W the sum of the gains."""
        if not self._is_judged:
            return np.zeros((1, G.shape[-1], self.n, self.n))
        runs, steps, b, c = linear.D.shape
        D = linear.D.transpose(0, 2, 1, 3).reshape(runs, b, steps * c)
        return unpacked((D @ G[:, :-1].reshape(runs, steps * c, -1)).swapaxes(1, 2), self.n) * self._frame

    def _node_slopes(self, values: Values, G: np.ndarray, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self._nodes is None:
            return np.zeros((0, self.q)), np.zeros(self.q)
        x, u = self._places(values.along)
        both = self._nodes.slopes(x, u)
        count, n = self._nodes.margins, self.n
        ends = np.vstack([M, M[-1:]])
        node, margin = values.node, self.rows.margin
        at_rows = both[node, margin]
        later = np.flatnonzero(values.after > 0)
        if later.size:
            k = node[later]
            at_rows[later] = self._instants.slopes(x[k], u[k], values.after[later])[np.arange(len(k)), margin[later]]
        rows = np.matmul(at_rows[:, None, :n], G[0, node, :n])[:, 0]
        if np.any(at_rows[:, n:]):
            rows = rows + np.matmul(at_rows[:, None, n:], ends[node])[:, 0]
        costs = both[:-1, count:]
        totals = self.problem.step * (
            np.einsum("krn,knq->rq", costs[:, :, :n], G[0, :-1, :n]) + np.einsum("krm,kmq->rq", costs[:, :, n:], M)
        )
        cut = len(self._per_unit)
        return np.vstack([rows, -totals[cut:] / self._most[:, None]]), self._per_unit @ totals[:cut]

    # ---------------------------------------------------------------- second derivatives

    def curvature(self, values: Values, slopes: Slopes, multipliers: Multipliers) -> np.ndarray:
        """Return the Hessian (q, q) of the Lagrangian: price - sum <Z, matrix> - sum <Z, floor> - z'rows, weighted."""
        injected = self._injected(values, multipliers)
        H, pushed = self._window_bends(values, slopes, multipliers, injected)
        weights = np.zeros((len(self._starts), self._variation.b))
        if self._is_judged:
            weights[self.judged] = self._weights(multipliers.matrices)
        second = self._variation.second(values.along, weights, injected)
        H += _folded(second.K, second.R, slopes.G[:, :-1], slopes.M)
        if not self._inputs.is_linear:
            H += self._inputs.bend(values.p, (second.slope.sum(axis=0) + pushed).ravel()).full()
        return (H + H.T) / 2

    def mixed(self, values: Values, slopes: Slopes, Z: np.ndarray) -> np.ndarray:
        """Return -d2 <Z, S W S> / dp d due (N, S, q) along the path itself, Z (n, n)."""
        along, sensors = values.along, self._sensors
        own, aside = (self._due[:, :sensors] != 0).astype(float), self._due[:, sensors:]
        each = np.eye(sensors)[:, None, :] * np.broadcast_to(own, (sensors, *own.shape))
        each = np.concatenate([each, np.broadcast_to(aside, (sensors, *aside.shape))], axis=2)
        same = Along(np.repeat(along.z[:1], sensors, axis=0), np.repeat(along.u[:1], sensors, axis=0), each)
        D = np.einsum("b,skbc->skc", self._weights(Z[None])[0], self._variation.linear(same).D)
        return np.einsum("skc,kcq->ksq", D, slopes.G[0, :-1])

    def _weights(self, Z: np.ndarray) -> np.ndarray:
        """Weights (b, .) of the packed gains in -<Z, S W S>."""
        rows, columns = lower_indices(self.n)
        return -(Z * self._frame)[:, rows, columns] * np.where(rows == columns, 1.0, 2.0)

    def _injected(self, values: Values, multipliers: Multipliers) -> Injected:
        runs, v = len(self._starts), self.n + self.m
        g, H = np.zeros((runs, self.steps + 1, v)), np.zeros((runs, self.steps + 1, v, v))
        if self._nodes is not None:
            count, rows = self._nodes.margins, len(self.rows.node)
            weights, now = np.zeros((self.steps + 1, len(self._nodes.owner))), values.after == 0
            np.add.at(weights, (values.node[now], self.rows.margin[now]), -multipliers.rows[:rows][now])
            budgets = multipliers.rows[rows : rows + len(self._most)]
            weights[:-1, count:] = self.problem.step * np.concatenate([multipliers.price * self._per_unit, budgets / self._most])
            wanted = np.flatnonzero(weights.any(axis=1))
            if wanted.size:
                x, u = self._places(values.along)
                g[0, wanted], H[0, wanted] = self._nodes.bends(x[wanted], u[wanted], weights[wanted])
            self._inject_later(values, multipliers, g[0], H[0])
        return Injected(g, H)

    def _inject_later(self, values: Values, multipliers: Multipliers, g: np.ndarray, H: np.ndarray) -> None:
        """Add to g (N+1, v) and H (N+1, v, v) what rows between the nodes bend."""
        later = np.flatnonzero((values.after > 0) & (multipliers.rows[: len(values.after)] != 0))
        if later.size:
            (x, u), k = self._places(values.along), values.node[later]
            weights = np.zeros((len(later), self._nodes.margins if self._nodes else 0))
            weights[np.arange(len(later)), self.rows.margin[later]] = -multipliers.rows[later]
            slope, bend = self._instants.bends(x[k], u[k], values.after[later], weights)
            np.add.at(g, k, slope)
            np.add.at(H, k, bend)
            once = np.isin(later, [row for choice in self.rows.choices for row in choice.rows])
            if once.any():
                more = self._instants.following(x[k[once]], u[k[once]], values.after[later[once]])
                np.add.at(H, k[once], np.einsum("kr,krvw->kvw", weights[once], more))

    # ---------------------------------------------------------------- windows

    @cached_property
    def _first_of_window(self) -> np.ndarray:
        """First steps (f,) of the stretches that a floor is asked for: every half of their length, and the last stretch."""
        floor = self.problem.floor
        if floor is None:
            return np.zeros(0, dtype=int)
        length = self._window_length
        return np.unique(np.append(np.arange(0, self.steps - length + 1, max(1, length // 2)), self.steps - length))

    @property
    def _window_length(self) -> int:
        floor = self.problem.floor
        return 0 if floor is None else round(floor.seconds / self.problem.step)

    @cached_property
    def _window_steps(self) -> np.ndarray:
        return self._first_of_window[:, None] + np.arange(self._window_length)

    def _windows(self, along: Along, u: np.ndarray) -> tuple[Along | None, np.ndarray]:
        if self.problem.floor is None:
            return None, np.zeros((0, self.n, self.n))
        starts, steps = along.z[0, self._first_of_window, : self.n], self._window_steps
        walk, sums = self._variation.along(starts, u[steps], self._due[steps])
        return walk, unpacked(sums, self.n) * self._frame

    def _window_slopes(self, values: Values, G: np.ndarray, M: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
        if values.windows is None:
            return None, np.zeros((0, self.q, self.n, self.n))
        linear = self._variation.linear(values.windows)
        first = np.zeros((len(self._first_of_window), self._variation.c, self.q))
        first[:, : self.n] = G[0, self._first_of_window, : self.n]
        moved = carried(linear, first, M[self._window_steps])
        return moved, self._summed(linear, moved)

    def _window_bends(self, values: Values, slopes: Slopes, multipliers: Multipliers, injected: Injected) -> tuple[np.ndarray, np.ndarray]:
        """Return what the windows' own inputs add to the Hessian, and their slopes (N, m); their first states' part is injected."""
        pushed = np.zeros((self.steps, self.m))
        if values.windows is None or slopes.windows is None:
            return np.zeros((self.q, self.q)), pushed
        second = self._variation.second(values.windows, self._weights(multipliers.floors), None)
        n = self.n
        for i, first in enumerate(self._first_of_window):
            injected.g[0, first, :n] += second.first[i, :n]
            injected.H[0, first, :n, :n] += second.start[i, :n, :n]
            pushed[self._window_steps[i]] += second.slope[i]
        return _folded(second.K, second.R, slopes.windows[:, :-1], slopes.M[self._window_steps]), pushed


def _folded(K: np.ndarray, R: np.ndarray, G: np.ndarray, M: np.ndarray) -> np.ndarray:
    """sum_k M_k'(K_k G_k) + its transpose + M_k'R_k M_k (q, q), over all runs; M (N, m, q), or (M, N, m, q) for each run its own."""
    q = G.shape[-1]
    half = (K @ G).sum(axis=0) + 0.5 * (R.sum(axis=0) @ M) if M.ndim == 3 else K @ G + 0.5 * (R @ M)
    Y = M.reshape(-1, q).T @ half.reshape(-1, q)
    return Y + Y.T


def _beside(model: Model, due: np.ndarray, known: Knowledge | None, segments: int | None) -> list[np.ndarray]:
    """Return what the recursion is told of each step (N, .) beside how much each sensor's sample counts."""
    if known is not None:
        return [(np.arange(len(due)) == len(due) - 1).astype(float)[:, None]]
    colour = colour_of(model)
    if colour is None:
        return []
    if segments is None:
        return [due]
    firsts = np.arange(0, len(due), len(due) // segments)
    return [due, *counting(colour, due[:, colour.sensor_of] > 0, firsts).rows(firsts)]


@lru_cache(CACHED)
def _variation_of(model: Model, pace: tuple[float, int], known: Knowledge | None, counted: bool) -> Variation:
    step, substeps = pace
    recursion = gramian_recursion(model, step, substeps, counted) if known is None else posterior_recursion(model, step, known, substeps)
    return Variation(recursion, len(model.states))


@lru_cache(CACHED)
def _bare_variation_of(model: Model, pace: tuple[float, int]) -> Variation:
    return Variation(bare_recursion(model, *pace), len(model.states))
