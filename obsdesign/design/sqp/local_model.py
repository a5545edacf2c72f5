"""The convex model of a program about one of its points, and its solution."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.design.sqp.active_set_step import ActiveCone, KKTSystem, newton_step
from obsdesign.design.sqp.conic_model import Cone, ConicQP, ConicSolution
from obsdesign.design.sqp.conic_qp import minimise
from obsdesign.design.sqp.convexification import ACTIVE_MULTIPLIER, active_normals, convexify
from obsdesign.design.sqp.evaluation import AbstractDerivatives, Multipliers
from obsdesign.design.sqp.matrix_objective import (
    AbstractMatrixObjective,
    combination_curvature,
    initial_weights,
)
from obsdesign.design.sqp.merit import Iterate, MeritFunction, MeritScaling, largest_violation

FEASIBILITY_TOLERANCE = 1e-7  # by how much a margin, of order 1, may fall short
_NEAR_MARGIN = 0.3  # margins below this are in every model; others when a model's solution would break them
_QP_TOLERANCE = 1e-9  # of Clarabel


@dataclass(frozen=True, eq=False)
class LocalModel:
    """An iterate with its derivatives, the Hessian H (q, q) of the Lagrangian, and B, what of it is convex.

    epigraph_rows + epigraph_jacobian d - t >= 0: the numbers of several matrices, the least of which counts. epigraph_weights: what each t
    counts. negative_curvature (q,): where curvature is most negative, one width of the box long; None where it nowhere is.
    """

    merit_function: MeritFunction
    iterate: Iterate
    derivatives: AbstractDerivatives
    floor_derivatives: np.ndarray
    H: np.ndarray
    B: np.ndarray
    g: np.ndarray
    epigraph_rows: np.ndarray
    epigraph_jacobian: np.ndarray
    epigraph_weights: np.ndarray
    negative_curvature: np.ndarray | None


@dataclass(frozen=True, eq=False)
class ModelSolution:
    """A model's minimiser, the rows that it knew of, and what the model says the merit is there."""

    qp_solution: ConicSolution
    row_indices: np.ndarray
    predicted_merit: float

    @property
    def d(self) -> np.ndarray:
        """The step (q,)."""
        return self.qp_solution.d


def build_model(
    merit_function: MeritFunction,
    iterate: Iterate,
    derivatives: AbstractDerivatives,
    multipliers: Multipliers,
    at_bound: np.ndarray,
    scaling: MeritScaling,
) -> LocalModel:
    """Return the model's data; multipliers weigh the curvatures, at_bound (q,) says which parameters lie on their bounds."""
    evaluation, objective = iterate.evaluation, merit_function.objective
    H, g = merit_function.program.lagrangian_hessian(evaluation, derivatives, multipliers), derivatives.price / scaling.unit
    epigraph_rows, epigraph_jacobian = np.zeros(0), np.zeros((0, len(g)))
    if not objective.is_cone:
        weights = initial_weights(objective, evaluation.matrices)
        objective_jacobian = np.einsum("bij,bqij->bq", objective.gradients(evaluation.matrices), derivatives.matrices) / scaling.unit
        H = H + np.einsum("b,bij->ij", weights, objective.curvatures(evaluation.matrices, derivatives.matrices)) / scaling.unit
        if objective.combination.is_smallest and len(evaluation.matrices) > 1:
            epigraph_rows, epigraph_jacobian = objective.values(evaluation.matrices) / scaling.unit, objective_jacobian
        else:
            g = g - weights @ objective_jacobian
    curvature = combination_curvature(objective, evaluation.matrices, derivatives.matrices)
    H = H if curvature is None else H + curvature / scaling.unit
    width = merit_function.width
    B, negative_curvature = convexify(H * np.outer(width, width), active_normals(objective, derivatives, multipliers, at_bound, width))
    negative_curvature = None if negative_curvature is None else negative_curvature * width
    return LocalModel(
        merit_function,
        iterate,
        derivatives,
        merit_function.floor_derivatives(derivatives),
        H,
        B / np.outer(width, width),
        g,
        epigraph_rows,
        epigraph_jacobian,
        _epigraph_weights(objective, evaluation.matrices),
        negative_curvature,
    )


def solve_model(model: LocalModel, scaling: MeritScaling, radius: float) -> ModelSolution | None:
    """Minimise the model in the trust region, with the margins that are near and those that its solution would break."""
    evaluation = model.iterate.evaluation
    rows = np.flatnonzero(evaluation.rows < _NEAR_MARGIN)
    while True:
        qp_solution = minimise(_conic_qp(model, _base_point(model), rows, scaling, radius), _QP_TOLERANCE)
        if qp_solution is None:
            return None
        model_rows = evaluation.rows + model.derivatives.rows @ qp_solution.d + qp_solution.slack
        violated = model_rows < -FEASIBILITY_TOLERANCE / 10
        violated[rows] = False
        if not violated.any():
            return ModelSolution(qp_solution, rows, _predicted_merit(model, qp_solution.d, scaling))
        rows = np.union1d(rows, np.flatnonzero(violated))


def slack_at_weight(model: LocalModel, solution: ModelSolution, scaling: MeritScaling, radius: float, weight: float) -> float:
    """Return the slack that the model would need if its objective counted for a share only."""
    qp = _conic_qp(model, _base_point(model), solution.row_indices, scaling, radius)
    qp_solution = minimise(replace(qp, g=weight * qp.g, weights=weight * qp.weights), _QP_TOLERANCE)
    return np.inf if qp_solution is None else qp_solution.slack


def second_order_correction(
    model: LocalModel, solution: ModelSolution, trial: Iterate, scaling: MeritScaling, radius: float
) -> np.ndarray | None:
    """Return the step again, with limits and matrices as they turned out at its end (second-order correction)."""
    base = _base_after(model, solution.d, trial, scaling)
    qp_solution = minimise(_conic_qp(model, base, solution.row_indices, scaling, radius), _QP_TOLERANCE)
    return None if qp_solution is None else qp_solution.d


def active_set_step(
    model: LocalModel,
    solution: ModelSolution,
    scaling: MeritScaling,
    radius: float,
    *,
    uses_all_curvature: bool,
    earlier: tuple[np.ndarray, Iterate] | None = None,
) -> np.ndarray | None:
    """Return the best step on what the model's solution holds active, by linear equations alone; None where it leaves the region.

    uses_all_curvature: Newton's step; else with what of the curvature the model has. earlier: a step d (q,) and where it led to; limits and
    matrices are taken as they turned out there.
    """
    base = _base_point(model) if earlier is None else _base_after(model, earlier[0], earlier[1], scaling)
    qp_solution, width = solution.qp_solution, model.merit_function.width
    active_rows, active_epigraph_rows = (
        qp_solution.row_multipliers > ACTIVE_MULTIPLIER,
        qp_solution.epigraph_multipliers > ACTIVE_MULTIPLIER,
    )
    cones = _cones(model, base, scaling)
    active_cones = [
        ActiveCone(cone.A, cone.D, cone.E, cone.epigraph_index, Z)
        for cone, Z in zip(cones, qp_solution.Z, strict=True)
        if np.trace(Z) > ACTIVE_MULTIPLIER
    ]
    system = KKTSystem(
        model.H if uses_all_curvature else model.B,
        model.g,
        model.epigraph_weights,
        active_cones,
        base.rows[solution.row_indices][active_rows],
        model.derivatives.rows[solution.row_indices][active_rows],
        base.epigraph_rows[active_epigraph_rows],
        model.epigraph_jacobian[active_epigraph_rows],
        qp_solution.bound_multipliers > ACTIVE_MULTIPLIER,
        qp_solution.d,
    )
    d = newton_step(system)
    return None if d is None or float(np.max(np.abs(d) / width)) > radius else d


def bounds_of(model: LocalModel, solution: ModelSolution, radius: float) -> np.ndarray:
    """Return which parameters (q,) the solution holds at bounds of the box, not of the trust region."""
    program, p, width = model.merit_function.program, model.iterate.evaluation.p, model.merit_function.width
    limit = np.where(solution.d < 0, p - program.lower, program.upper - p)
    return (solution.qp_solution.bound_multipliers > ACTIVE_MULTIPLIER) & (limit <= radius * width)


def multipliers_of(model: LocalModel, solution: ModelSolution, scaling: MeritScaling) -> Multipliers:
    """Return the multipliers of a model's solution."""
    merit_function, evaluation, qp_solution = model.merit_function, model.iterate.evaluation, solution.qp_solution
    objective, matrix_count = merit_function.objective, len(evaluation.matrices)
    objective_cones = matrix_count if objective.is_cone else 0
    window_count = len(evaluation.floors)
    Z = np.array(qp_solution.Z).reshape(-1, *evaluation.matrices.shape[1:])
    if objective.is_cone:
        matrices = Z[:objective_cones] / scaling.unit
    else:
        weights = (
            qp_solution.epigraph_multipliers if len(qp_solution.epigraph_multipliers) else initial_weights(objective, evaluation.matrices)
        )
        matrices = objective.gradients(evaluation.matrices) * (weights / scaling.unit)[:, None, None]
    if merit_function.eigenvalue_floor:
        matrices = matrices + Z[objective_cones + window_count :] / merit_function.eigenvalue_floor
    rows = np.zeros(len(evaluation.rows))
    rows[solution.row_indices] = qp_solution.row_multipliers
    return Multipliers(
        matrices, Z[objective_cones : objective_cones + window_count] / merit_function.program.floor_level, rows, 1 / scaling.unit
    )


# ---------------------------------------------------------------- the model


@dataclass(frozen=True, eq=False)
class _BasePoint:
    """What limits and matrices are where the model begins: those of its place, or as a step turned out."""

    matrices: np.ndarray
    floors: np.ndarray
    rows: np.ndarray
    epigraph_rows: np.ndarray


def _base_point(model: LocalModel) -> _BasePoint:
    evaluation = model.iterate.evaluation
    return _BasePoint(evaluation.matrices, model.iterate.floors, evaluation.rows, model.epigraph_rows)


def _base_after(model: LocalModel, d: np.ndarray, trial: Iterate, scaling: MeritScaling) -> _BasePoint:
    """What limits and matrices would have to be at the iterate for their slopes to lead to what they are at a trial, d away."""
    evaluation, derivatives = trial.evaluation, model.derivatives
    return _BasePoint(
        evaluation.matrices - _change(d, derivatives.matrices),
        trial.floors - _change(d, model.floor_derivatives),
        evaluation.rows - derivatives.rows @ d,
        model.merit_function.objective.values(evaluation.matrices) / scaling.unit - model.epigraph_jacobian @ d
        if len(model.epigraph_rows)
        else model.epigraph_rows,
    )


def _conic_qp(model: LocalModel, base: _BasePoint, rows: np.ndarray, scaling: MeritScaling, radius: float) -> ConicQP:
    program, p, width = model.merit_function.program, model.iterate.evaluation.p, model.merit_function.width
    return ConicQP(
        model.B,
        model.g,
        model.epigraph_weights,
        scaling.penalty,
        np.maximum(program.lower - p, -radius * width),
        np.minimum(program.upper - p, radius * width),
        _cones(model, base, scaling),
        base.rows[rows],
        model.derivatives.rows[rows],
        base.epigraph_rows,
        model.epigraph_jacobian,
    )


def _cones(model: LocalModel, base: _BasePoint, scaling: MeritScaling) -> tuple[Cone, ...]:
    objective, n, cones = model.merit_function.objective, base.matrices.shape[-1], []
    if objective.is_cone:
        E = objective.cone_matrix(n)
        for i, (A, D) in enumerate(zip(base.matrices, model.derivatives.matrices, strict=True)):
            cones.append(Cone(A / scaling.unit, D / scaling.unit, E, 0 if objective.combination.is_smallest else i, 0.0))
    identity = np.eye(n)
    cones += [Cone(F - identity, D, identity, None, 1.0) for F, D in zip(base.floors, model.floor_derivatives, strict=True)]
    return tuple(cones)


def _epigraph_weights(objective: AbstractMatrixObjective, matrices: np.ndarray) -> np.ndarray:
    """Weights of the t in the model: one t for the worst of several, one each for a sum, none where the objective has a gradient."""
    is_smallest = objective.combination.is_smallest
    if objective.is_cone and not is_smallest:
        return initial_weights(objective, matrices)
    return np.ones(1) if objective.is_cone or (is_smallest and len(matrices) > 1) else np.zeros(0)


def _predicted_merit(model: LocalModel, d: np.ndarray, scaling: MeritScaling) -> float:
    """The model's merit after a step, recomputed: what a solver reports is a claim."""
    evaluation, objective = model.iterate.evaluation, model.merit_function.objective
    if objective.is_cone:
        moved = objective.values(evaluation.matrices + _change(d, model.derivatives.matrices))
        value = objective.combination.model_total(objective.values(evaluation.matrices), moved) / scaling.unit
    else:
        value = (
            float((model.epigraph_rows + model.epigraph_jacobian @ d).min())
            if len(model.epigraph_rows)
            else model.iterate.objective_value / scaling.unit
        )
    rows = evaluation.rows + model.derivatives.rows @ d
    floors = model.iterate.floors + _change(d, model.floor_derivatives)
    quadratic = model.g @ d + 0.5 * d @ model.B @ d + evaluation.price / scaling.unit
    return float(quadratic - value + scaling.penalty * largest_violation(rows, floors))


def _change(d: np.ndarray, derivatives: np.ndarray) -> np.ndarray:
    """By how much matrices (b, n, n) change along d (q,), by their derivatives (b, q, n, n)."""
    b, q, n, _ = derivatives.shape
    return (d @ derivatives.reshape(b, q, n * n)).reshape(b, n, n)
