"""The loops of filters and smoothers, of the graphs of an estimator and of a model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from obsdesign.dynamics.model import Model
from obsdesign.dynamics.process_noise import model_with_noisy_inputs
from obsdesign.dynamics.scan import Scan
from obsdesign.dynamics.step import CACHE_SIZE
from obsdesign.estimation._linear_update import linear_innovations, sequential_update
from obsdesign.estimation._motion import Motion
from obsdesign.estimation._noise import NoiseForm, NoiseGraph, noise_graph
from obsdesign.estimation._samples import SampleInnovations, Samples
from obsdesign.estimation._spread import root_graph, root_of_columns, spread_symbols
from obsdesign.estimation.abstract import AbstractFilter, BeliefGraph, Moved, Prediction
from obsdesign.estimation.gate import apply_gate
from obsdesign.information.householder import triangular_factor


@dataclass(frozen=True)
class FilterKey:
    """What the loops of a filter depend on: the filter, the length of a step, its sub-steps, whether roots are carried, the form of noise.

    has_increments: whether a row is added to the state after each step, which the filter knows of.
    """

    filter: AbstractFilter
    step: float
    substeps: int
    has_roots: bool
    noise: NoiseForm
    has_increments: bool = False


@dataclass(frozen=True, eq=False)
class _Graphs:
    """Symbols of a filter's loop: the carry (X, spread, counters), and the rows y, active and noise."""

    key: FilterKey
    model: Model
    motion: Motion
    belief: BeliefGraph
    counters: ca.SX
    carry: ca.SX
    samples: Samples
    noise: NoiseGraph
    increment: ca.SX

    @property
    def step_rows(self) -> list[ca.SX]:
        """The rows of a step: inputs, process noise, and increments if there are any."""
        return [self.model.u, self.noise.row, *([self.increment[: self.model.x.numel(), :]] if self.key.has_increments else [])]

    def update(self) -> _Updated:
        """Take in the samples."""
        innovations, gate = self.key.filter.innovations(self.samples, self.belief), self.key.filter.gate
        belief, is_taken, counters = self.belief, innovations.is_usable, self.counters
        is_alarm = ca.SX.zeros(len(self.model.channels))
        if gate is not None and self.model.outputs:
            gating = apply_gate(gate, self.model, innovations, counters)
            belief = BeliefGraph(belief.mean, belief.spread.inflate(gating.factor))
            is_taken, is_alarm, counters = gating.is_taken, gating.is_alarm, gating.counters_next
        updated = self.key.filter.update(self.samples, belief, is_taken) if self.model.outputs else belief
        return _Updated(updated, counters, innovations, is_taken, is_alarm)

    def move(self, belief: BeliefGraph) -> Moved:
        """Move a belief on."""
        moved = self.key.filter.move(self.motion, belief, self.noise)
        if not self.key.has_increments:
            return moved
        return Moved(BeliefGraph(moved.belief.mean + self.increment, moved.belief.spread), moved.loop)


@dataclass(frozen=True, eq=False)
class _Updated:
    """A belief after the samples of an instant, and what became of these."""

    belief: BeliefGraph
    counters: ca.SX
    innovations: SampleInnovations
    is_taken: ca.SX
    is_alarm: ca.SX

    def carry(self, belief: BeliefGraph) -> ca.SX:
        """What is carried on, with this belief."""
        return ca.vertcat(belief.mean, belief.spread.column, self.counters)

    def report(self, model: Model) -> list[ca.SX]:
        """Return residual (q,), its variance (q,), its normalised square (S,), what is usable and taken in (q,), and alarms (S,)."""
        nis = [self.innovations.normalised_square(outputs) for outputs in model.outputs_of.values()]
        variance = ca.diag(self.innovations.covariance)
        return [
            self.innovations.residual,
            variance,
            ca.vertcat(*nis),
            ca.SX(self.innovations.is_usable),
            ca.SX(self.is_taken),
            self.is_alarm,
        ]


@lru_cache(CACHE_SIZE)
def predict_scan(key: FilterKey, model: Model) -> Scan:
    """Carry, rows of a step -> carry one step later."""
    graphs = _graphs(key, model)
    moved = graphs.move(graphs.belief)
    carry = ca.vertcat(moved.belief.mean, moved.belief.spread.column, graphs.counters)
    return Scan(graphs.carry, graphs.step_rows, carry, loop=moved.loop)


@lru_cache(CACHE_SIZE)
def update_scan(key: FilterKey, model: Model) -> Scan:
    """Carry, rows y and active -> carry after the samples; results: what became of them."""
    graphs = _graphs(key, model)
    updated = graphs.update()
    samples = graphs.samples
    return Scan(graphs.carry, [samples.y, samples.active], updated.carry(updated.belief), updated.report(model))


@lru_cache(CACHE_SIZE)
def filter_scan(key: FilterKey, model: Model) -> Scan:
    """Carry, rows y, active and of a step -> carry after an update and a step; results: mean (n,) and covariance (n n,) between them."""
    graphs, n = _graphs(key, model), model.x.numel()
    updated = graphs.update()
    return _both(graphs, updated, [updated.belief.mean[:n, :], ca.vec(updated.belief.spread.covariance[:n, :n])])


@lru_cache(CACHE_SIZE)
def report_scan(key: FilterKey, model: Model) -> Scan:
    """The same; results: X and the column of its spread between them, and what became of the samples."""
    graphs = _graphs(key, model)
    updated = graphs.update()
    return _both(graphs, updated, [updated.belief.mean, updated.belief.spread.column, *updated.report(model)])


@lru_cache(CACHE_SIZE)
def innovation_scan(key: FilterKey, model: Model) -> Scan:
    """The same of an EKF; results (q,): what is new in each output after those before it, 0 without one, and its variance."""
    graphs = _graphs(key, model)
    samples, belief = graphs.samples, graphs.belief
    outputs = samples.linearise(belief.mean)
    residual = samples.residual(outputs.expected)
    is_usable = samples.is_usable(outputs.C, residual, outputs.variance)
    after, innovations, variances = sequential_update(belief, outputs, residual, is_usable)
    updated = _Updated(after, graphs.counters, linear_innovations(samples, belief), is_usable, ca.SX.zeros(len(model.channels)))
    return _both(graphs, updated, [ca.densify(ca.vertcat(*innovations)), ca.densify(ca.vertcat(*variances))])


@lru_cache(CACHE_SIZE)
def smoother_scan(key: FilterKey, model: Model) -> Scan:
    """Carry (X, S) at t_k+1 given all samples, rows X and S at t_k given those until then, and of a step -> the same at t_k.

    The lower triangular root of [F S Q^1/2; S 0] is [A 0; B D], so that P_k+1 = A A' is predicted, G = B A^-1 the gain, and
    X_k + G (X_k+1 - f(X_k)) with S_k S_k' = D D' + G S_k+1 S_k+1' G'.
    Source: Rauch, Tung, Striebel (1965), with roots as in Park and Kailath (1995).
    """
    graphs = _graphs(key, model)
    n = graphs.motion.size
    later, later_column = spread_symbols("later", n, has_roots=True)
    X_later = ca.SX.sym("X_later", n)
    prediction = key.filter.predict(graphs.motion, graphs.belief)
    added = graphs.noise.at(graphs.belief.mean[: model.x.numel(), :], prediction.B)
    gain, remainder = _smoother_gain(prediction, root_graph(added))
    predicted = prediction.mean + graphs.increment if key.has_increments else prediction.mean
    mean = graphs.belief.mean + gain @ (X_later - predicted)
    column = root_of_columns(remainder, gain @ root_graph(later)).column
    rows = [graphs.belief.mean, graphs.belief.spread.column, *graphs.step_rows]
    return Scan(ca.vertcat(X_later, later_column), rows, ca.vertcat(mean, column), loop=prediction.loop)


def _smoother_gain(prediction: Prediction, noise: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return G = B A^-1, 0 along what is known exactly, and D."""
    n = prediction.mean.numel()
    upper = ca.horzcat(prediction.after, noise)
    lower = ca.horzcat(prediction.before, ca.SX(n, noise.shape[1]))
    root = triangular_factor(ca.vertcat(upper, lower).T).T
    A, B = root[:n, :n], root[n:, :n]
    columns: list[ca.SX] = [ca.SX.zeros(n)] * n
    for j in reversed(range(n)):
        rest = B[:, j] - sum((columns[i] * A[i, j] for i in range(j + 1, n)), ca.SX(0))
        columns[j] = ca.if_else(A[j, j] != 0, rest / ca.if_else(A[j, j] != 0, A[j, j], 1), 0)
    return ca.horzcat(*columns), root[n:, n:]


def _both(graphs: _Graphs, updated: _Updated, results: list[ca.SX]) -> Scan:
    """An update and a step."""
    moved, samples = graphs.move(updated.belief), graphs.samples
    rows = [samples.y, samples.active, *graphs.step_rows]
    return Scan(graphs.carry, rows, updated.carry(moved.belief), results, loop=moved.loop)


def _graphs(key: FilterKey, model: Model) -> _Graphs:
    model = model_with_noisy_inputs(model, key.noise.inputs)
    motion = Motion(model, key.step, key.substeps, len(key.noise.inputs))
    n, q, size = model.x.numel(), len(model.outputs), motion.size
    X = ca.vertcat(model.x, ca.SX.sym("errors", size - n))
    spread, column = spread_symbols("spread", size, key.has_roots)
    noise = noise_graph(key.noise, model, key.has_roots, motion.nuisance_noise if key.has_roots and size > n else None)
    counters = ca.SX.sym("counters", 0 if key.filter.gate is None else 2 * len(model.channels))
    samples = Samples(model, motion.nuisance, ca.SX.sym("y", q), ca.SX.sym("active", q))
    carry = ca.vertcat(X, column, counters)
    increment = ca.vertcat(ca.SX.sym("increment", n), ca.SX.zeros(size - n))
    return _Graphs(key, model, motion, BeliefGraph(X, spread), counters, carry, samples, noise, increment)
