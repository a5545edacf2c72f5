"""The relaxation in one piece, by CVXPY: a second opinion on column generation, for small problems."""

from __future__ import annotations

import warnings
from threading import Lock

import cvxpy as cp
import numpy as np

from obsdesign.selection.pricing.cardinality import Top
from obsdesign.selection.problem import Instance, matrices
from obsdesign.selection.relaxation.column_generation import Relaxed, mixture_of
from obsdesign.selection.relaxation.dual import Dual
from obsdesign.selection.relaxation.restricted_master import normalised
from obsdesign.selection.scaled_criterion import Judge

_TURN = Lock()  # what warnings are shown belongs to the process
_ACCEPTED = (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)  # the bound is recomputed: an inaccurate dual only makes it weaker


def relaxed_directly(instance: Instance, time_limit: float | None) -> Relaxed | None:
    """max min_r criterion(known + sum_ks kept_rs w_ks V_ks) over 0 <= w <= 1, sum_s w_ks <= m, usage'w <= limits; None without an answer.

    Only where the sensors of a segment are restricted by their number alone.
    """
    if not isinstance(instance.schedules, Top):
        return None
    weights, t = cp.Variable(instance.shape, bounds=[0, 1]), cp.Variable()
    information = [_mixed(instance, weights, kept) for kept in instance.kept]
    metric, smallest = instance.judge.metric, instance.criterion.is_smallest_eigenvalue
    above = [cp.PSD(V - t * np.diag(metric / metric.max())) for V in information] if smallest else []
    shadows = [] if smallest else [_shadow(instance, V) for V in information]
    concave = [cp.NonNeg(instance.criterion.atom(S) - t) for S, _ in shadows]
    limits = [cp.NonNeg(each.limit - cp.sum(cp.multiply(each.usage, weights))) for each in instance.resources]
    few = cp.NonNeg(instance.schedules.per_segment - cp.sum(weights, axis=1))
    available = cp.NonNeg(instance.schedules.available.astype(float) - weights)
    parts = [cone for _, cones in shadows for cone in cones]
    problem = cp.Problem(cp.Maximize(t), [few, available, *limits, *above, *concave, *parts])
    if not _solved(problem, time_limit) or weights.value is None:
        return None
    shares = np.clip(np.asarray(weights.value), 0.0, 1.0)
    V = _information(instance, shares)
    if not np.isfinite(instance.judged(V)):
        return None
    mu = np.maximum(_duals(limits), 0.0)
    if smallest:
        Z = np.stack([np.asarray(cone.dual_value) for cone in above])
        dual = Dual(normalised(Z, metric / metric.max()) / metric.max(), mu / metric.max(), 0.0)
    else:
        split = np.maximum(_duals(concave), 0.0)
        dual = _tangent(instance.judge, V, split / split.sum(), mu)
    return mixture_of(instance, shares, dual)


def _duals(constraints: list[cp.NonNeg]) -> np.ndarray:
    return np.array([float(np.asarray(each.dual_value).squeeze()) for each in constraints])


def _mixed(instance: Instance, weights: cp.Variable, kept: np.ndarray) -> cp.Expression:
    K, S = instance.shape
    n = instance.n
    blocks = matrices(instance.rows, n) * kept[:, None, None]
    columns = blocks.reshape(K * S, n * n).T
    V = cp.reshape(columns @ cp.vec(weights, order="C"), (n, n), order="C") + instance.known
    return (V + V.T) / 2


def _shadow(instance: Instance, V: cp.Expression) -> tuple[cp.Expression, list[cp.PSD]]:
    """What V leaves for the judged states, in their own units; and what holds it down: [V_aa - S, V_ab; V_ba, V_bb] >= 0."""
    judge = instance.judge
    own = np.diag(1 / judge.D[judge.about])
    pick = np.eye(instance.n)[judge.order]
    if not len(judge.nuisance):
        return own @ V @ own, []
    first, S = len(judge.nuisance), cp.Variable((len(judge.about),) * 2, symmetric=True)
    place = np.eye(instance.n)[:, first:]
    return own @ S @ own, [cp.PSD(pick @ V @ pick.T - place @ S @ place.T)]


def _information(instance: Instance, shares: np.ndarray) -> np.ndarray:
    by_sensor = np.einsum("ks,ksd->sd", shares, instance.rows)
    return matrices(instance.kept @ by_sensor, instance.n) + instance.known


def _tangent(judge: Judge, V: np.ndarray, split: np.ndarray, mu: np.ndarray) -> Dual:
    tangents = [judge.tangent(each) for each in V]
    slopes, offsets = np.stack([Z for Z, _ in tangents]), np.array([offset for _, offset in tangents])
    return Dual(split[:, None, None] * slopes, mu, float(split @ offsets))


def _solved(problem: cp.Problem, time_limit: float | None) -> bool:
    options = {} if time_limit is None else {"time_limit": time_limit}
    try:
        with _TURN, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # "may be inaccurate": see _ACCEPTED
            problem.solve(solver=cp.CLARABEL, **options)
    except cp.SolverError:
        return False
    return problem.status in _ACCEPTED
