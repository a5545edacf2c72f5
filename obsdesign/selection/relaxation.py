"""The relaxation in one piece, by CVXPY: a second opinion on column generation, for small problems."""

from __future__ import annotations

import warnings
from threading import Lock

import cvxpy as cp
import numpy as np

from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.selection.columns import Relaxed, mixture_of
from obsdesign.selection.duals import Dual
from obsdesign.selection.instance import Instance, matrices
from obsdesign.selection.master import normalised
from obsdesign.selection.top import Top

_TURN = Lock()  # what warnings are shown belongs to the process
_ACCEPTED = (cp.OPTIMAL, cp.OPTIMAL_INACCURATE)  # the bound is recomputed: an inaccurate dual only makes it weaker


def relaxed_directly(instance: Instance, time_limit: float | None) -> Relaxed | None:
    """max min_r criterion(sum_ks kept_rs w_ks W_ks) over 0 <= w <= 1, sum_s w_ks <= m, usage'w <= limits; None without an answer.

    Solved as D W D with D = diag(W of all sensors)^-1/2, so that the numbers are of one size; only where the sensors of a segment are
    restricted by their number alone.
    """
    if not isinstance(instance.schedules, Top):
        return None
    everything = np.diagonal(instance.information(np.ones(instance.shape, dtype=bool)).sum(axis=0))
    D = 1 / np.sqrt(np.where(everything > 0, everything, 1.0))
    weights, t = cp.Variable(instance.shape, bounds=[0, 1]), cp.Variable()
    information = [_mixed(instance, weights, kept, D) for kept in instance.kept]
    # a criterion of D^-1 V D^-1 in terms of V: t is bounded through V - t D^2 where it is an eigenvalue
    unit = 1 / max(float((D**2).max()), np.finfo(float).tiny)
    smallest = instance.criterion.is_smallest_eigenvalue
    above = [cp.PSD(V - t * unit * np.diag(D**2)) for V in information] if smallest else []
    concave = [] if smallest else [cp.NonNeg(instance.criterion.atom(_unscaled(V, D)) - t) for V in information]
    limits = [cp.NonNeg(each.limit - cp.sum(cp.multiply(each.usage, weights))) for each in instance.resources]
    few = cp.NonNeg(instance.schedules.per_segment - cp.sum(weights, axis=1))
    available = cp.NonNeg(instance.schedules.available.astype(float) - weights)
    problem = cp.Problem(cp.Maximize(t), [few, available, *limits, *above, *concave])
    if not _solved(problem, time_limit) or weights.value is None:
        return None
    shares = np.clip(np.asarray(weights.value), 0.0, 1.0)
    if not np.isfinite(instance.judged(_information(instance, shares))):
        return None
    mu = np.maximum(_duals(limits), 0.0)
    if smallest:
        Z = np.stack([np.asarray(cone.dual_value) * np.outer(D, D) for cone in above])
        dual = Dual(normalised(Z), mu * unit, 0.0)
    else:
        split = np.maximum(_duals(concave), 0.0)
        dual = _tangent(instance.criterion, _information(instance, shares), split / split.sum(), mu)
    return mixture_of(instance, shares, dual)


def _duals(constraints: list[cp.NonNeg]) -> np.ndarray:
    return np.array([float(np.asarray(each.dual_value).squeeze()) for each in constraints])


def _mixed(instance: Instance, weights: cp.Variable, kept: np.ndarray, D: np.ndarray) -> cp.Expression:
    K, S = instance.shape
    n = instance.n
    blocks = matrices(instance.rows, n) * np.outer(D, D) * kept[:, None, None]
    columns = blocks.reshape(K * S, n * n).T
    W = cp.reshape(columns @ cp.vec(weights, order="C"), (n, n), order="C")
    return (W + W.T) / 2


def _unscaled(V: cp.Expression, D: np.ndarray) -> cp.Expression:
    inverse = np.diag(1 / D)
    return inverse @ V @ inverse


def _information(instance: Instance, shares: np.ndarray) -> np.ndarray:
    by_sensor = np.einsum("ks,ksd->sd", shares, instance.rows)
    return matrices(instance.kept @ by_sensor, instance.n)


def _tangent(criterion: AbstractCriterion, W: np.ndarray, split: np.ndarray, mu: np.ndarray) -> Dual:
    slopes = np.stack([criterion.slope(each) for each in W])
    offsets = [criterion.value(each) - float(np.sum(slope * each)) for each, slope in zip(W, slopes, strict=True)]
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
