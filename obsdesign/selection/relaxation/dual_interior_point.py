"""The relaxation by an interior-point method whose linear algebra is only as wide as the dual: for many states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from obsdesign.conic import smat, svec
from obsdesign.selection.dual import Dual
from obsdesign.selection.pricing.cardinality import CardinalitySchedules, top_of
from obsdesign.selection.problem import SelectionProblem

_BARRIER_REDUCTION = 0.15  # of the barrier from one centre to the next
_MAX_STEPS = 80  # of Newton's method at most: 16 centres take the barrier to 0.15^16 = 1e-13, which leaves five to each
_CENTRING_TOLERANCE = 0.5  # Newton decrement, in units of mu, at which the barrier shrinks
_BISECTIONS = 60  # halvings: 2^-60 of the bracket is less than a double tells
_BACKTRACKING, _MAX_BACKTRACKS = 0.6, 40
# _RIDGE: on a matrix of unit diagonal: some hundred times the rounding of a double, so that its factor exists; steps bend by as little
_RIDGE = 1e-13
_MIN_METRIC_RATIO = 1e-12  # ratio of what the states count, below which the barrier does not see them


@dataclass(frozen=True, eq=False)
class CentralPoint:
    """Relaxed choices (K, S) and the dual."""

    shares: np.ndarray
    dual: Dual


def is_applicable(instance: SelectionProblem) -> bool:
    """Whether the relaxation is one that this method knows: a smallest eigenvalue, and limits per segment alone."""
    plain = (
        isinstance(instance.schedules, CardinalitySchedules)
        and not instance.resources
        and len(instance.working_sensors) == 1
        and not instance.known_information.any()
    )
    metric = instance.scaled_criterion.metric
    return plain and instance.criterion.is_smallest_eigenvalue and float(metric.min()) > _MIN_METRIC_RATIO * float(metric.max())


def follow_central_path(instance: SelectionProblem, gap: float) -> CentralPoint:
    """Minimise sum_k phi_k(<W_k1, Z>, ...) - mu log det Z over Z > 0 with tr Z = 1, for mu falling until the gap is closed.

    phi_k(p) = max over 0 < s < 1, sum s < m of p's + mu (sum log s (1 - s) + log(m - sum s)) is the best choice of a segment with a
    barrier; its maximiser is the relaxed choice. Newton's equations have n (n + 1) / 2 unknowns, whatever K and S are. At a centre
    the gap is at most mu times the number of barriers.
    """
    problem = _scale_problem(instance)
    Z = np.diag(1 / np.diag(problem.E)) / instance.n
    count = instance.n + 2 * int(problem.available.sum()) + len(problem.available)
    mu = _evaluate(problem, Z, 0.0).best / count
    point = _evaluate(problem, Z, mu)
    for _ in range(_MAX_STEPS):
        newton_step = _newton_direction(problem, Z, mu, point)
        if newton_step is None:
            break  # as far as double precision goes; the bound is recomputed from Z
        direction, decrement = newton_step
        if decrement <= _CENTRING_TOLERANCE * mu:
            if mu * count <= 0.3 * gap * point.best:
                break
            mu *= _BARRIER_REDUCTION
            point = _evaluate(problem, Z, mu)
            continue
        Z, point = _line_search(problem, Z, mu, point, direction, decrement)
    scaled_Z = Z * np.outer(problem.D, problem.D)
    total = float(np.diag(scaled_Z) @ instance.scaled_criterion.metric)
    return CentralPoint(np.clip(point.s, 0.0, 1.0), Dual((scaled_Z / total)[None], np.zeros(0), 0.0))


@dataclass(frozen=True, eq=False)
class _BarrierProblem:
    """Blocks as vectors (K, S, d) in units D in which all sensors know one of each state; <E, Z> counts there."""

    rows: np.ndarray
    D: np.ndarray
    E: np.ndarray
    available: np.ndarray
    per_segment: int


@dataclass(frozen=True, eq=False)
class _BarrierPoint:
    """What a dual leads to: objective, best choices' worth without a barrier, relaxed choices s, their slopes h, and kappa (K,).

    kappa: the slope of what room is worth in a segment.
    """

    objective: float
    best: float
    s: np.ndarray
    h: np.ndarray
    kappa: np.ndarray


def _scale_problem(instance: SelectionProblem) -> _BarrierProblem:
    schedules = top_of(instance.schedules)
    everything = np.diagonal(instance.all_information[0])
    D = 1 / np.sqrt(np.where(everything > 0, everything, 1.0))
    rows = instance.block_vectors * svec(np.outer(D, D) * (1 + (1 / np.sqrt(2) - 1) * (1 - np.eye(instance.n))))
    metric = instance.scaled_criterion.metric * D**2
    E = np.diag(metric) / metric.max()
    return _BarrierProblem(np.ascontiguousarray(rows), D, E, schedules.available, schedules.per_segment)


def _evaluate(problem: _BarrierProblem, Z: np.ndarray, mu: float) -> _BarrierPoint:
    K, S, d = problem.rows.shape
    price = np.where(problem.available, (problem.rows.reshape(K * S, d) @ svec(Z)).reshape(K, S), -np.inf)
    largest_prices = -np.sort(-price, axis=1)[:, : problem.per_segment]
    best = float(np.maximum(largest_prices, 0.0).sum())
    if mu == 0:
        return _BarrierPoint(best, best, price, price, price[:, 0])
    nu = _slot_price(price, problem.per_segment, mu)
    s = _barrier_choice(price - nu[:, None], mu)
    slack = mu / nu
    with np.errstate(divide="ignore", invalid="ignore"):
        barrier = np.where(problem.available, np.log(s) + np.log1p(-s), 0.0)
        gain = np.where(problem.available, price * s, 0.0)
    objective = float(gain.sum() + mu * (barrier.sum() + np.log(slack).sum()))
    objective -= mu * float(np.linalg.slogdet(Z)[1])
    h = np.where(problem.available, (s * (1 - s)) ** 2 / (mu * (s**2 + (1 - s) ** 2)), 0.0)
    return _BarrierPoint(objective, best, s, h, mu / slack**2)


def _barrier_choice(x: np.ndarray, mu: float) -> np.ndarray:
    """The maximiser of x s + mu (log s + log(1 - s))."""
    with np.errstate(invalid="ignore"):
        s = 2 * mu / (2 * mu - x + np.sqrt(x**2 + 4 * mu**2))
    return np.where(np.isfinite(x), s, 0.0)


def _slot_price(price: np.ndarray, m: int, mu: float) -> np.ndarray:
    """nu (K,) > 0 with sum s(price - nu) + mu / nu = m: what room in a segment is worth; by bisection of its logarithm."""
    finite = np.where(np.isfinite(price), price, 0.0)
    low, high = np.full(len(price), np.log(0.5 * mu / m)), np.log(np.maximum(finite.max(axis=1), 0.0) + 4 * mu * price.shape[1] + mu)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        nu = np.exp(middle)
        above = _barrier_choice(price - nu[:, None], mu).sum(axis=1) + mu / nu > m
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.exp((low + high) / 2)


def _newton_direction(problem: _BarrierProblem, Z: np.ndarray, mu: float, point: _BarrierPoint) -> tuple[np.ndarray, float] | None:
    """Newton's direction within <E, Z> = const, and the decrease it promises; None where the equations are singular."""
    K, S, d = problem.rows.shape
    flat = problem.rows.reshape(K * S, d)
    inverse = np.linalg.inv(Z)
    gradient = point.s.ravel() @ flat - mu * svec(inverse)
    # sum_s h a a' - kappa / (1 + kappa sum h) (sum h a)(sum h a)' as a sum of squares: differences of them lose what is small
    total = point.h.sum(axis=1)
    share = (1 - 1 / np.sqrt(1 + point.kappa * total)) / np.maximum(total, np.finfo(float).tiny)
    mean = (point.h[:, None, :] @ problem.rows) * share[:, None, None]
    weighted = ((problem.rows - mean) * np.sqrt(point.h)[:, :, None]).reshape(K * S, d)
    H = weighted.T @ weighted + mu * _kronecker(inverse)
    e = svec(problem.E)
    size = 1 / np.sqrt(np.diag(H))  # its entries differ by the squares of those of Z
    try:
        factor = linalg.cho_factor(H * np.outer(size, size) + _RIDGE * np.eye(d))
    except linalg.LinAlgError:
        return None
    gradient_solve, constraint_solve = (size * linalg.cho_solve(factor, size * side) for side in (gradient, e))
    direction = -(gradient_solve - constraint_solve * (e @ gradient_solve) / (e @ constraint_solve))
    return direction, max(float(-(gradient @ direction)), 0.0)


def _kronecker(inverse: np.ndarray) -> np.ndarray:
    """The matrix (d, d) of V -> inverse V inverse on vectors of symmetric matrices."""
    n = len(inverse)
    basis = smat(np.eye(n * (n + 1) // 2), n)
    return svec(inverse @ basis @ inverse)


def _line_search(
    problem: _BarrierProblem, Z: np.ndarray, mu: float, point: _BarrierPoint, direction: np.ndarray, decrement: float
) -> tuple[np.ndarray, _BarrierPoint]:
    """Step along a direction until the objective falls enough; Z stays positive definite."""
    V = smat(direction, len(Z))
    root = np.linalg.inv(np.linalg.cholesky(Z))
    lowest = float(np.linalg.eigvalsh(root @ V @ root.T)[0])
    length = min(1.0, 0.95 / -lowest) if lowest < 0 else 1.0
    trial = _evaluate(problem, Z + length * V, mu)
    for _ in range(_MAX_BACKTRACKS):
        if trial.objective <= point.objective - 0.1 * length * decrement:
            break
        length *= _BACKTRACKING
        trial = _evaluate(problem, Z + length * V, mu)
    return Z + length * V, trial
