"""The relaxation in one piece, by CVXPY: a second opinion on column generation, for small problems."""

from __future__ import annotations

import warnings
from threading import Lock

import cvxpy as cp
import numpy as np

from obsdesign.conic import smat
from obsdesign.selection.dual import Dual
from obsdesign.selection.pricing.cardinality import CardinalitySchedules
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column_generation import RelaxedSolution, uniform_mixture
from obsdesign.selection.relaxation.restricted_master import normalise_dual
from obsdesign.selection.scaled_criterion import ScaledCriterion

_WARNINGS_LOCK = Lock()  # what warnings are shown belongs to the process
_ACCEPTED = (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)  # the bound is recomputed: an inaccurate dual only makes it weaker


def solve_with_cvxpy(instance: SelectionProblem, time_limit: float | None) -> RelaxedSolution | None:
    """max min_r criterion(known + sum_ks kept_rs w_ks V_ks) over 0 <= w <= 1, sum_s w_ks <= m, usage'w <= limits; None without an answer.

    Only where the sensors of a segment are restricted by their number alone.
    """
    if not isinstance(instance.schedules, CardinalitySchedules):
        return None
    weights, t = cp.Variable(instance.shape, bounds=[0, 1]), cp.Variable()
    information = [_mixture_information(instance, weights, working) for working in instance.working_sensors]
    metric, smallest = instance.scaled_criterion.metric, instance.criterion.is_smallest_eigenvalue
    eigenvalue_cones = [cp.PSD(V - t * np.diag(metric / metric.max())) for V in information] if smallest else []
    schur_complements = [] if smallest else [_schur_complement(instance, V) for V in information]
    concave = [cp.NonNeg(instance.criterion.atom(S) - t) for S, _ in schur_complements]
    limits = [cp.NonNeg(resource.limit - cp.sum(cp.multiply(resource.usage, weights))) for resource in instance.resources]
    cardinality = cp.NonNeg(instance.schedules.per_segment - cp.sum(weights, axis=1))
    available = cp.NonNeg(instance.schedules.available.astype(float) - weights)
    schur_cones = [cone for _, cones in schur_complements for cone in cones]
    problem = cp.Problem(cp.Maximize(t), [cardinality, available, *limits, *eigenvalue_cones, *concave, *schur_cones])
    if not _solve(problem, time_limit) or weights.value is None:
        return None
    shares = np.clip(np.asarray(weights.value), 0.0, 1.0)
    V = _information(instance, shares)
    if not np.isfinite(instance.mixture_value(V)):
        return None
    mu = np.maximum(_duals(limits), 0.0)
    if smallest:
        Z = np.stack([np.asarray(cone.dual_value) for cone in eigenvalue_cones])
        dual = Dual(normalise_dual(Z, metric / metric.max()) / metric.max(), mu / metric.max(), 0.0)
    else:
        scenario_weights = np.maximum(_duals(concave), 0.0)
        dual = _tangent_dual(instance.scaled_criterion, V, scenario_weights / scenario_weights.sum(), mu)
    return uniform_mixture(instance, shares, dual)


def _duals(constraints: list[cp.NonNeg]) -> np.ndarray:
    return np.array([float(np.asarray(constraint.dual_value).squeeze()) for constraint in constraints])


def _mixture_information(instance: SelectionProblem, weights: cp.Variable, working: np.ndarray) -> cp.Expression:
    K, S = instance.shape
    n = instance.n
    blocks = smat(instance.block_vectors, n) * working[:, None, None]
    columns = blocks.reshape(K * S, n * n).T
    V = cp.reshape(columns @ cp.vec(weights, order="C"), (n, n), order="C") + instance.known_information
    return (V + V.T) / 2


def _schur_complement(instance: SelectionProblem, V: cp.Expression) -> tuple[cp.Expression, list[cp.PSD]]:
    """What V leaves for the judged states, in their own units; and what holds it down: [V_aa - S, V_ab; V_ba, V_bb] >= 0."""
    judge = instance.scaled_criterion
    unit_scaling = np.diag(1 / judge.D[judge.about])
    permutation = np.eye(instance.n)[judge.order]
    if not len(judge.nuisance):
        return unit_scaling @ V @ unit_scaling, []
    first, S = len(judge.nuisance), cp.Variable((len(judge.about),) * 2, symmetric=True)
    embedding = np.eye(instance.n)[:, first:]
    return unit_scaling @ S @ unit_scaling, [cp.PSD(permutation @ V @ permutation.T - embedding @ S @ embedding.T)]


def _information(instance: SelectionProblem, shares: np.ndarray) -> np.ndarray:
    by_sensor = np.einsum("ks,ksd->sd", shares, instance.block_vectors)
    return smat(instance.working_sensors @ by_sensor, instance.n) + instance.known_information


def _tangent_dual(judge: ScaledCriterion, V: np.ndarray, scenario_weights: np.ndarray, mu: np.ndarray) -> Dual:
    tangents = [judge.tangent(scenario_information) for scenario_information in V]
    slopes, offsets = np.stack([Z for Z, _ in tangents]), np.array([offset for _, offset in tangents])
    return Dual(scenario_weights[:, None, None] * slopes, mu, float(scenario_weights @ offsets))


def _solve(problem: cp.Problem, time_limit: float | None) -> bool:
    options = {} if time_limit is None else {"time_limit": time_limit}
    try:
        with _WARNINGS_LOCK, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # "may be inaccurate": see _ACCEPTED
            problem.solve(solver=cp.CLARABEL, **options)
    except cp.SolverError:
        return False
    return problem.status in _ACCEPTED
