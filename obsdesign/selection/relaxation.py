"""Choosing sensors: relax, bound in closed form, round, exchange."""

from __future__ import annotations

import warnings

import cvxpy as cp
import numpy as np
from numpy.typing import ArrayLike

from obsdesign.checks import require_count, require_positive
from obsdesign.errors import InputError, SolveError
from obsdesign.selection.exchange import improved
from obsdesign.selection.naive import at_random
from obsdesign.selection.schedule import Schedule, best_for, largest_per_row, require_blocks, schedule_value, upper_bound
from obsdesign.status import Status

_RESTARTS = 16  # random schedules improved beside the rounded ones: rounding alone has lost 1 % at K = 24 ...
_FEW = 400  # ... while K S is at most this

_STATUS = {
    cp.OPTIMAL: Status.OPTIMAL,
    cp.OPTIMAL_INACCURATE: Status.OPTIMAL,  # the bound is recomputed: an inaccurate dual only makes it weaker
    cp.USER_LIMIT: Status.TIME_LIMIT,
    cp.INFEASIBLE: Status.INFEASIBLE,
}


def select_sensors(
    blocks: ArrayLike, per_segment: int = 1, gap: float = 1e-9, time_limit: float | None = None, seed: int = 0, throw: bool = True
) -> Schedule:
    """max lambda_min(sum_k sum_s chosen_ks W_ks) with at most per_segment sensors on in each segment.

    blocks (K, S, n, n), symmetric and >= 0, in any unit (scale them first: S W S). The relaxation is an SDP; its dual Z gives
    the bound in closed form, so that the certificate does not depend on the solver's status; the rounded schedule, and random
    ones where there are few segments, are improved by exchanges.
    Status OPTIMAL when gap is reached, else GAP_OPEN; time_limit [s] concerns the solver.
    Raises InputError for bad blocks, SolveError when the solver fails (throw=False: the failed Schedule).
    Source: Brace and Morgansen, eq. (12).
    """
    array = require_blocks(np.asarray(blocks), per_segment)
    if not (np.isfinite(gap) and gap >= 0):
        raise InputError(f"gap is {gap!r}: must be a finite number of at least 0")
    if time_limit is not None:
        require_positive("time_limit", time_limit)
    require_count("seed", seed, least=0)
    relaxed, Z, status = _relaxed(array, per_segment, time_limit)
    if not status.has_answer:
        if throw:
            raise SolveError("sensor selection", status)
        return _failed(array, status)
    random = np.random.default_rng(seed)
    K, S = array.shape[:2]
    restarts = _RESTARTS if K * S <= _FEW else 0
    rounded = [best_for(array, Z, per_segment), largest_per_row(relaxed, per_segment)]
    drawn = [at_random(K, S, per_segment, random) for _ in range(restarts)]
    chosen = max((improved(array, first, Z) for first in rounded + drawn), key=lambda candidate: schedule_value(array, candidate))
    fractional = int(np.any((relaxed > 1e-6) & (relaxed < 1 - 1e-6), axis=1).sum())
    return _certified(array, chosen, Z, per_segment, gap, fractional)


def _relaxed(blocks: np.ndarray, per_segment: int, time_limit: float | None) -> tuple[np.ndarray, np.ndarray, Status]:
    """Return the relaxed schedule (K, S), the dual Z and how Clarabel ended.

    Solved as D W D - t D^2 >= 0 with D = diag(W of all sensors)^-1/2: the same problem, well conditioned.
    """
    K, S, n, _ = blocks.shape
    total = np.diagonal(blocks.sum(axis=(0, 1)))
    D = 1 / np.sqrt(np.where(total > 0, total, 1.0))
    columns = (blocks * np.outer(D, D)).reshape(K * S, n * n).T
    unit = 1 / max(float((D**2).max()), np.finfo(float).tiny)  # t is measured in this unit
    weights, t = cp.Variable((K, S), bounds=[0, 1]), cp.Variable()
    scaled = cp.reshape(columns @ cp.vec(weights, order="C"), (n, n), order="C") - t * unit * np.diag(D**2)
    semidefinite = cp.PSD((scaled + scaled.T) / 2)
    problem = cp.Problem(cp.Maximize(t), [semidefinite, cp.NonNeg(per_segment - cp.sum(weights, axis=1))])
    options = {} if time_limit is None else {"time_limit": time_limit}
    nothing = np.full((K, S), np.nan), np.full((n, n), np.nan)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # "may be inaccurate": see _STATUS
            problem.solve(solver=cp.CLARABEL, **options)
    except cp.SolverError:
        return *nothing, Status.NUMERICAL_ERROR
    status = _STATUS.get(problem.status, Status.NUMERICAL_ERROR)
    if not status.has_answer or semidefinite.dual_value is None or weights.value is None:
        return *nothing, Status.NUMERICAL_ERROR if status.has_answer else status
    return weights.value, _normalised(np.asarray(semidefinite.dual_value) * np.outer(D, D)), status


def _normalised(Z: np.ndarray) -> np.ndarray:
    """The nearest Z >= 0 with trace 1: what makes UB(Z) a bound whatever the solver returned."""
    values, vectors = np.linalg.eigh((Z + Z.T) / 2)
    values = np.maximum(values, 0.0)
    if not values.sum() > 0:
        values = np.ones_like(values)
    return (vectors * (values / values.sum())) @ vectors.T


def _certified(blocks: np.ndarray, chosen: np.ndarray, Z: np.ndarray, per_segment: int, gap: float, fractional: int) -> Schedule:
    value, bound = schedule_value(blocks, chosen), upper_bound(blocks, Z, per_segment)
    bound = max(bound, value)  # they may cross by a rounding error
    reached = 1 - value / bound if bound > 0 else 0.0
    status = Status.OPTIMAL if reached <= gap else Status.GAP_OPEN
    return Schedule(chosen, value, bound, bound, reached, Z, fractional, status)


def _failed(blocks: np.ndarray, status: Status) -> Schedule:
    n = blocks.shape[2]
    none = np.zeros(blocks.shape[:2], dtype=bool)
    return Schedule(none, np.nan, np.nan, np.nan, np.nan, np.full((n, n), np.nan), 0, status)
