"""A design problem as functions of the path's parameters: matrices to be large, margins to be positive, and their derivatives."""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from obsdesign.criteria.abstract import Knowledge
from obsdesign.design.instants import Instants, instants_of
from obsdesign.design.nlp.evaluation import NO_ROWS, ConstraintRows, Derivatives, Evaluation
from obsdesign.design.nlp.information_recursion import gramian_recursion, posterior_recursion, state_recursion
from obsdesign.design.nlp.input_map import input_map_of
from obsdesign.design.nlp.node_terms import NodeTerms
from obsdesign.design.nlp.rollout import NodeCosts, Rollout, RolloutFunctions
from obsdesign.design.nlp.sensitivity import Linearisation, PathSensitivity, propagate_sensitivity
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.evaluation import Multipliers
from obsdesign.design.sqp.nonlinear_program import AbstractProgram
from obsdesign.dynamics.model import Model
from obsdesign.dynamics.step import CACHE_SIZE
from obsdesign.information.additive_amounts import additive_factors
from obsdesign.information.correlated_noise import colour_of
from obsdesign.information.sample_information import sampling_mask
from obsdesign.packing import lower_indices, unpack


class Program(AbstractProgram[Evaluation, Derivatives]):
    """The functions of one problem with one duration. Nothing changes after construction.

    segments: where errors are not independent, count the amounts that `segment_information` has for so many segments, linear in
    the weights, instead of all that the samples say together. with_information: otherwise no information is carried along the path, its
    matrix is 0 and limits alone count; not with a floor.
    """

    def __init__(
        self, problem: DesignProblem, rows: ConstraintRows | None = None, segments: int | None = None, with_information: bool = True
    ) -> None:
        self.problem, model = problem, problem.system.model
        self.n, self.m, self.steps = len(model.states), len(model.inputs), problem.steps
        self._has_information = with_information or problem.floor is not None
        knowledge, step, pace = (
            problem.criterion.knowledge if self._has_information else None,
            problem.step,
            (problem.step, problem.substeps),
        )
        self._variation = (
            _rollout_functions_of(model, pace, knowledge, segments is not None) if self._has_information else _state_rollout_of(model, pace)
        )
        self._instants = instants_of(problem.criterion, self.steps) if self._has_information else None
        self._due = sampling_mask(problem.system, self.steps, step).astype(float)
        self._sensors, extra_inputs = self._due.shape[1], _extra_input_rows(model, self._due, (knowledge, self._instants), segments)
        if problem.weights is not None:
            self._due = self.due(np.asarray(problem.weights))
        self._due = np.hstack([self._due, *(extra_inputs if self._has_information else ())])
        self.lower, self.upper = problem.path.box(problem.grid)
        self._input_map = input_map_of(problem.path, problem.grid)
        self.rows = NO_ROWS if rows is None else rows
        self._node_terms = NodeTerms(problem, self.rows)
        # the path itself comes first; draws of the prior, where there are any, are judged in its place
        robust = problem.robust if self._has_information else None
        draws = [] if robust is None else [robust.draws(robust.samples, 0)]
        self._starts = np.vstack([problem.x0[None], *draws])
        self.judged = slice(0 if robust is None else 1, len(self._starts))
        self._unit_scaling = np.outer(problem.units, problem.units)

    @property
    def q(self) -> int:
        """Number of parameters."""
        return len(self.lower)

    @property
    def floor_level(self) -> float:
        """The problem's floor."""
        return 1.0 if self.problem.floor is None else self.problem.floor.value

    def inputs(self, p: np.ndarray) -> np.ndarray:
        """Return u (N, m)."""
        if self._input_map.is_linear:
            offset, slope = self._input_map.line
            return (offset + slope @ p).reshape(self.steps, self.m)
        return self._input_map.value(p).full().reshape(self.steps, self.m)

    def due(self, weights: np.ndarray) -> np.ndarray:
        """Return how much each sensor's sample counts at each step (N, S) for weights (K, S) of K equal groups of steps."""
        step_weights, S = np.repeat(weights, self.steps // len(weights), axis=0), self._sensors
        return np.hstack([self._due[:, :S] * step_weights, self._due[:, S:]]) if self._due.shape[1] > S else self._due * step_weights

    # ---------------------------------------------------------------- values

    def evaluate(self, p: np.ndarray, due: np.ndarray | None = None) -> Evaluation:
        """Return the values at p (q,); due (N, S): what samples count for instead."""
        u = self.inputs(p)
        rollout, gains = self._variation.roll_out(self._starts, u, self._due if due is None else due)
        window_rollouts, floors = self._windows(rollout, u)
        rows, price, node, delay = self._node_terms.evaluate(rollout)
        rows = np.concatenate([rows, self._rate_rows(p)[0]])
        matrices = (
            self.problem.criterion_matrix(unpack(self._judged_sums(gains), self.n))
            if self._has_information
            else np.zeros((1, self.n, self.n))
        )
        return Evaluation(p, matrices, floors, rows, price, rollout, window_rollouts, node, delay)

    def _judged_sums(self, gains: np.ndarray) -> np.ndarray:
        """Return the packed matrices (b, .) that are judged: of each draw what all steps gain, or of the path what each instant has."""
        return gains.sum(axis=1)[self.judged] if self._instants is None else gains[0, self._instants.steps]

    def margins(self, evaluation: Evaluation) -> np.ndarray:
        """Return all margins (N+1, r) of the constraints at all nodes."""
        return self._node_terms.values(evaluation.rollout)[0]

    def _rate_rows(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """1 -+ rate / limit for each rate of change, and the derivatives (., q)."""
        limits = self.problem.rates
        if not limits:
            return np.zeros(0), np.zeros((0, self.q))
        values, slopes = (output.full() for output in self._input_map.rates(p))
        count = len(values) // self.m
        limited = [i * count + j for i, name in enumerate(self.problem.system.model.input_names) if name in limits for j in range(count)]
        limit = np.repeat([limits[name] for name in self.problem.system.model.input_names if name in limits], count)
        rate, slope = values.ravel()[limited] / limit, slopes[limited] / limit[:, None]
        return np.concatenate([1 - rate, 1 + rate]), np.vstack([-slope, slope])

    # ---------------------------------------------------------------- first derivatives

    def derivatives(self, evaluation: Evaluation) -> Derivatives:
        """Return the first derivatives where the values were taken."""
        M = self._input_jacobian(evaluation.p)
        linearisation = self._variation.linearise(evaluation.rollout)
        initial = np.zeros((len(self._starts), self._variation.c, self.q))
        sensitivity = propagate_sensitivity(linearisation, initial, M)
        G, matrices = sensitivity.G, self._judged_derivatives(linearisation, sensitivity)
        window_sensitivity, floors = self._window_derivatives(evaluation, G, M)
        rows, price = self._node_terms.derivatives(evaluation, G, M)
        rates = self._rate_rows(evaluation.p)[1]
        return Derivatives(matrices, floors, np.vstack([rows, rates]), price, M, G, window_sensitivity)

    def _input_jacobian(self, p: np.ndarray) -> np.ndarray:
        if self._input_map.is_linear:
            return self._input_map.line[1].reshape(self.steps, self.m, self.q)
        return self._input_map.jacobian(p).full().reshape(self.steps, self.m, self.q)

    def _judged_derivatives(self, linearisation: Linearisation, sensitivity: PathSensitivity) -> np.ndarray:
        """Derivatives (b, q, n, n) of the matrices that are judged."""
        if self._instants is None:
            return self._matrix_derivatives(sensitivity)[self.judged]
        k = self._instants.steps
        return unpack((linearisation.D[0, k] @ sensitivity.G[0, k]).swapaxes(1, 2), self.n) * self._unit_scaling

    def _matrix_derivatives(self, sensitivity: PathSensitivity) -> np.ndarray:
        """Derivatives (M, q, n, n) of S W S, W the sum of the gains."""
        if not self._has_information:
            return np.zeros((1, self.q, self.n, self.n))
        return unpack(sensitivity.gains.swapaxes(1, 2), self.n) * self._unit_scaling

    # ---------------------------------------------------------------- second derivatives

    def lagrangian_hessian(self, evaluation: Evaluation, derivatives: Derivatives, multipliers: Multipliers) -> np.ndarray:
        """Return the Hessian (q, q) of the Lagrangian: price - sum <Z, matrix> - sum <Z, floor> - z'rows, weighted."""
        node_costs = self._node_terms.lagrangian(evaluation, multipliers)
        H, input_gradient = self._window_hessian(evaluation, derivatives, multipliers, node_costs)
        second_derivatives = self._variation.second_derivatives(evaluation.rollout, self._gain_weights(multipliers), node_costs)
        H += _assemble_hessian(second_derivatives.K, second_derivatives.R, derivatives.G[:, :-1], derivatives.M)
        if not self._input_map.is_linear:
            H += self._input_map.hessian(evaluation.p, (second_derivatives.input_gradient.sum(axis=0) + input_gradient).ravel()).full()
        return (H + H.T) / 2

    def _gain_weights(self, multipliers: Multipliers) -> np.ndarray:
        """What the Lagrangian counts the packed gains for, (M, 1, b) of all steps of each run, or (1, N, b) of each step."""
        weights = np.zeros((len(self._starts), 1 if self._instants is None else self.steps, self._variation.b))
        if self._instants is not None:
            weights[0, self._instants.steps] = self._packed_weights(multipliers.matrices)
        elif self._has_information:
            weights[self.judged, 0] = self._packed_weights(multipliers.matrices)
        return weights

    def cross_derivatives(self, evaluation: Evaluation, derivatives: Derivatives, Z: np.ndarray) -> np.ndarray:
        """Return -d2 <Z, S W S> / dp d due (N, S, q) along the path itself, Z (n, n)."""
        rollout, sensors = evaluation.rollout, self._sensors
        is_sampled, extra_inputs = (self._due[:, :sensors] != 0).astype(float), self._due[:, sensors:]
        single_sensor = np.eye(sensors)[:, None, :] * np.broadcast_to(is_sampled, (sensors, *is_sampled.shape))
        single_sensor = np.concatenate([single_sensor, np.broadcast_to(extra_inputs, (sensors, *extra_inputs.shape))], axis=2)
        repeated = Rollout(np.repeat(rollout.z[:1], sensors, axis=0), np.repeat(rollout.u[:1], sensors, axis=0), single_sensor)
        D = np.einsum("b,skbc->skc", self._packed_weights(Z[None])[0], self._variation.linearise(repeated).D)
        return np.einsum("skc,kcq->ksq", D, derivatives.G[0, :-1])

    def _packed_weights(self, Z: np.ndarray) -> np.ndarray:
        """Weights (b, .) of the packed gains in -<Z, S W S>."""
        rows, columns = lower_indices(self.n)
        return -(Z * self._unit_scaling)[:, rows, columns] * np.where(rows == columns, 1.0, 2.0)

    # ---------------------------------------------------------------- windows

    @cached_property
    def _window_starts(self) -> np.ndarray:
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
        return self._window_starts[:, None] + np.arange(self._window_length)

    def _windows(self, rollout: Rollout, u: np.ndarray) -> tuple[Rollout | None, np.ndarray]:
        if self.problem.floor is None:
            return None, np.zeros((0, self.n, self.n))
        starts, steps = rollout.z[0, self._window_starts, : self.n], self._window_steps
        window_rollouts, gains = self._variation.roll_out(starts, u[steps], self._due[steps])
        return window_rollouts, unpack(gains.sum(axis=1), self.n) * self._unit_scaling

    def _window_derivatives(self, evaluation: Evaluation, G: np.ndarray, M: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
        if evaluation.window_rollouts is None:
            return None, np.zeros((0, self.q, self.n, self.n))
        linearisation = self._variation.linearise(evaluation.window_rollouts)
        initial = np.zeros((len(self._window_starts), self._variation.c, self.q))
        initial[:, : self.n] = G[0, self._window_starts, : self.n]
        sensitivity = propagate_sensitivity(linearisation, initial, M[self._window_steps])
        return sensitivity.G, self._matrix_derivatives(sensitivity)

    def _window_hessian(
        self, evaluation: Evaluation, derivatives: Derivatives, multipliers: Multipliers, node_costs: NodeCosts
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what the windows' own inputs add to the Hessian, and their slopes (N, m); their first states' part is injected."""
        input_gradient = np.zeros((self.steps, self.m))
        if evaluation.window_rollouts is None or derivatives.window_sensitivity is None:
            return np.zeros((self.q, self.q)), input_gradient
        weights = self._packed_weights(multipliers.floors)[:, None]
        second_derivatives = self._variation.second_derivatives(evaluation.window_rollouts, weights, None)
        n = self.n
        for i, first in enumerate(self._window_starts):
            node_costs.g[0, first, :n] += second_derivatives.initial_gradient[i, :n]
            node_costs.H[0, first, :n, :n] += second_derivatives.initial_hessian[i, :n, :n]
            input_gradient[self._window_steps[i]] += second_derivatives.input_gradient[i]
        return _assemble_hessian(
            second_derivatives.K, second_derivatives.R, derivatives.window_sensitivity[:, :-1], derivatives.M[self._window_steps]
        ), input_gradient


def _assemble_hessian(K: np.ndarray, R: np.ndarray, G: np.ndarray, M: np.ndarray) -> np.ndarray:
    """sum_k M_k'(K_k G_k) + its transpose + M_k'R_k M_k (q, q), over all runs; M (N, m, q), or (M, N, m, q) for each run its own."""
    q = G.shape[-1]
    half = (K @ G).sum(axis=0) + 0.5 * (R.sum(axis=0) @ M) if M.ndim == 3 else K @ G + 0.5 * (R @ M)
    Y = M.reshape(-1, q).T @ half.reshape(-1, q)
    return Y + Y.T


def _extra_input_rows(
    model: Model, due: np.ndarray, asked: tuple[Knowledge | None, Instants | None], segments: int | None
) -> list[np.ndarray]:
    """Return what the recursion is told of each step (N, .) beside how much each sensor's sample counts."""
    knowledge, instants = asked
    if knowledge is not None:
        return [np.isin(np.arange(len(due)), len(due) - 1 if instants is None else instants.steps).astype(float)[:, None]]
    colour = colour_of(model)
    if colour is None:
        return []
    if segments is None:
        return [due]
    firsts = np.arange(0, len(due), len(due) // segments)
    return [due, *additive_factors(colour, due[:, colour.sensor_of_output] > 0, firsts).rows(firsts)]


@lru_cache(CACHE_SIZE)
def _rollout_functions_of(model: Model, pace: tuple[float, int], knowledge: Knowledge | None, counted: bool) -> RolloutFunctions:
    step, substeps = pace
    recursion = (
        gramian_recursion(model, step, substeps, counted) if knowledge is None else posterior_recursion(model, step, knowledge, substeps)
    )
    return RolloutFunctions(recursion, len(model.states))


@lru_cache(CACHE_SIZE)
def _state_rollout_of(model: Model, pace: tuple[float, int]) -> RolloutFunctions:
    return RolloutFunctions(state_recursion(model, *pace), len(model.states))
