"""The dual of many partial schedules at a time, its corners rounded off: Newton's method on all of them together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from obsdesign.conic import smat, svec
from obsdesign.selection.integer.reduced_problem import ReducedProblem
from obsdesign.selection.problem import SelectionProblem

_EPS = float(np.finfo(float).eps)
_RIDGE = 1e-13  # on a unit diagonal: some hundred times the rounding of a double, so that its factor exists; steps bend by as little
_STEP_SHARE = 0.9  # of the way to where Z is singular, at most
_ARMIJO, _BACK, _TRIALS = 0.1, 0.4, 5
_MIN_DECREASE = 0.02  # of tau: a decrease that is not worth a step


@dataclass(frozen=True, eq=False)
class SmoothedDual:
    """Duals y = (Z_1, ..., Z_R, mu) (c,) of schedules that take one step of every layer, in units of a root bound.

    f(y) = base'y + tau sum_k log sum_p exp(d_kp'y / tau) - tau (sum_r log det Z_r + sum log mu) over e'y = sum_r <E, Z_r> = 1.
    increments d (K, A, c): information as vectors and minus usage, of at most A steps a layer, exists (K, A) bool; base (c,): what is
    decided and known, and limits less what is decided takes; sizes (n,): square roots of the diagonal of all information.
    As tau falls to 0, f falls to UB(y) = base'y + sum_k max_p d_kp'y, which is a bound for every y with Z_r >= 0, mu >= 0.
    """

    increments: np.ndarray
    exists: np.ndarray
    base: np.ndarray
    e: np.ndarray
    sizes: np.ndarray
    scenarios: int
    tau: float

    def with_tau(self, tau: float) -> SmoothedDual:
        """Return the same with corners rounded off as much."""
        return replace(self, tau=tau)

    @property
    def n(self) -> int:
        """The number of states."""
        return len(self.sizes)

    @cached_property
    def flat(self) -> np.ndarray:
        """Return the increments (K A, c), all layers in one."""
        return self.increments.reshape(-1, self.increments.shape[2])

    @cached_property
    def products(self) -> np.ndarray:
        """The products (K A, c (c + 1) / 2) of any two entries of each step."""
        i, j = np.tril_indices(self.increments.shape[2])
        return self.flat[:, i] * self.flat[:, j]

    @cached_property
    def product_index(self) -> np.ndarray:
        """Where the product of entries i and j (c, c) stands among the products."""
        i, j = np.tril_indices(self.increments.shape[2])
        index = np.empty((self.increments.shape[2],) * 2, dtype=int)
        index[i, j] = index[j, i] = np.arange(len(i))
        return index

    @property
    def entries(self) -> int:
        """How many entries of y are those of Z."""
        return self.scenarios * self.n * (self.n + 1) // 2

    def Z(self, y: np.ndarray) -> np.ndarray:
        """Return the duals (N, R, n, n) in y (N, c)."""
        return smat(y[:, : self.entries].reshape(len(y), self.scenarios, self.entries // self.scenarios), self.n)

    def scores(self, y: np.ndarray, allowed: np.ndarray) -> np.ndarray:
        """Return what every step is worth (N, K, A) under y (N, c); -inf where it is not allowed (N, K, A)."""
        return np.where(allowed, (y @ self.flat.T).reshape(allowed.shape), -np.inf)

    def bounds(self, y: np.ndarray, best: np.ndarray) -> np.ndarray:
        """Return UB (N,) from the best scores (N, K), and what rounding may take off it."""
        rounding = np.einsum("i,nrij,j->n", self.sizes, np.abs(self.Z(y)), self.sizes)
        return y @ self.base + best.sum(axis=1) + 4 * _EPS * rounding


@dataclass(frozen=True, eq=False)
class DualPoints:
    """Where duals y (N, c) are: f (N,), bounds (N,), shares of the steps (N, K, A)."""

    y: np.ndarray
    f: np.ndarray
    bound: np.ndarray
    shares: np.ndarray


@dataclass(frozen=True, eq=False)
class QuadraticModels:
    """f to second order at points: gradient (N, c), H (N, c, c) in units size (N, c), mean (N, K, c) of what each layer adds."""

    gradient: np.ndarray
    H: np.ndarray
    size: np.ndarray
    mean: np.ndarray


@dataclass(frozen=True, eq=False)
class Descent:
    """Where descents end, and the best duals (N, c) met on the way, with their bounds (N,)."""

    end: DualPoints
    dual: np.ndarray
    bound: np.ndarray


def smooth_dual(instance: SelectionProblem, reduced: ReducedProblem, unit: float) -> SmoothedDual:
    """Return the dual of what is undecided in segments without links, in units of a bound."""
    max_steps = max(len(layer.increments) for layer in reduced.layers)
    R, m = len(instance.working_sensors), len(instance.resources)
    increments = np.zeros((len(reduced.layers), max_steps, len(reduced.base) - 1))
    exists = np.zeros(increments.shape[:2], dtype=bool)
    for k, layer in enumerate(reduced.layers):
        increments[k, : len(layer.increments)] = layer.increments[:, :-1]
        exists[k, : len(layer.increments)] = True
    base = reduced.base[:-1].copy()
    entries = len(base) - m
    increments[..., entries:] *= -1.0
    base[entries:] = instance.rounded_limits - base[entries:]
    peak_usage = np.maximum(np.abs(base[entries:]), np.abs(increments[..., entries:]).max(axis=(0, 1), initial=0.0))
    size = np.concatenate([np.full(entries, unit), np.where(peak_usage > 0, peak_usage, 1.0)])
    increments, base = increments / size, base / size
    e = np.concatenate([np.tile(svec(np.diag(instance.scaled_criterion.metric)), R), np.zeros(m)])
    sizes = np.sqrt(np.maximum(np.diagonal(instance.all_information, axis1=1, axis2=2).max(axis=0), 0.0) / unit)
    return SmoothedDual(increments, exists, base, e, sizes, R, 1.0)


def evaluate_duals(problem: SmoothedDual, y: np.ndarray, allowed: np.ndarray) -> DualPoints:
    """Evaluate duals y (N, c) of what is allowed (N, K, A)."""
    scores = problem.scores(y, allowed)
    best = scores.max(axis=2)
    shares = np.exp((scores - best[:, :, None]) / problem.tau)
    total = shares.sum(axis=2)
    mu = y[:, problem.entries :]
    barrier = np.linalg.slogdet(problem.Z(y))[1].sum(axis=1) + np.log(mu).sum(axis=1)
    f = y @ problem.base + best.sum(axis=1) + problem.tau * (np.log(total).sum(axis=1) - barrier)
    return DualPoints(y, f, problem.bounds(y, best), shares / total[:, :, None])


def quadratic_models(problem: SmoothedDual, points: DualPoints) -> QuadraticModels:
    """Return the second-order model of f at points."""
    N, c = points.y.shape
    tau, entries, shares = problem.tau, problem.entries, points.shares
    inverse = np.linalg.inv(problem.Z(points.y))
    mu = points.y[:, entries:]
    mean = np.matmul(shares.swapaxes(0, 1), problem.increments).swapaxes(0, 1)
    barrier = np.concatenate([svec(inverse).reshape(N, entries), 1 / mu], axis=1)
    H = np.take(shares.reshape(N, -1) @ problem.products, problem.product_index, axis=1)
    diagonal = np.einsum("nii->ni", H)  # a view
    diagonal += 4 * c * _EPS * diagonal  # rounding
    H -= mean.swapaxes(1, 2) @ mean
    H /= tau
    d = entries // problem.scenarios
    basis = smat(np.eye(d), problem.n)
    for r in range(problem.scenarios):
        block = slice(r * d, (r + 1) * d)
        H[:, block, block] += tau * svec(inverse[:, None, r] @ basis @ inverse[:, None, r])
    resources = np.arange(entries, c)
    H[:, resources, resources] += tau / mu**2
    size = 1 / np.sqrt(np.diagonal(H, axis1=1, axis2=2))
    scaled = H * size[:, :, None] * size[:, None, :] + _RIDGE * np.eye(c)
    return QuadraticModels(problem.base + mean.sum(axis=1) - tau * barrier, scaled, size, mean)


def descend(problem: SmoothedDual, y: np.ndarray, allowed: np.ndarray, steps: int, threshold: float) -> Descent:
    """Take Newton steps from duals y (N, c) of what is allowed (N, K, A), until their bounds fall to `threshold` or f hardly falls."""
    end = evaluate_duals(problem, y, allowed)
    best = Descent(end, y.copy(), end.bound.copy())
    active = np.arange(len(y))
    for _ in range(steps):
        active = active[best.bound[active] > threshold]
        if not len(active):
            break
        direction, decrease = _newton_direction(problem, _subset(end, active))
        is_worthwhile = decrease > _MIN_DECREASE * problem.tau
        active, direction, decrease = active[is_worthwhile], direction[is_worthwhile], decrease[is_worthwhile]
        _line_search(problem, best, allowed, active, direction, decrease)
    return best


def _newton_direction(problem: SmoothedDual, points: DualPoints) -> tuple[np.ndarray, np.ndarray]:
    """Newton's directions (N, c) within e'y = const, and the decreases (N,) they promise."""
    local_model = quadratic_models(problem, points)
    right_sides = np.stack([local_model.gradient * local_model.size, problem.e * local_model.size], axis=2)
    unconstrained, correction = np.moveaxis(np.linalg.solve(local_model.H, right_sides) * local_model.size[:, :, None], 2, 0)
    direction = correction * ((unconstrained @ problem.e) / (correction @ problem.e))[:, None] - unconstrained
    return direction, -np.sum(local_model.gradient * direction, axis=1)


def _line_search(
    problem: SmoothedDual, best: Descent, allowed: np.ndarray, active: np.ndarray, direction: np.ndarray, decrease: np.ndarray
) -> None:
    """Move those that are active (M,) along their directions as far as f falls enough; in place."""
    length = _max_step(problem, best.end.y[active], direction)
    for _ in range(_TRIALS):
        if not len(active):
            return
        trial = evaluate_duals(problem, _normalise(problem, best.end.y[active] + length[:, None] * direction), allowed[active])
        is_better = trial.bound < best.bound[active]
        best.bound[active[is_better]], best.dual[active[is_better]] = trial.bound[is_better], trial.y[is_better]
        is_accepted = trial.f <= best.end.f[active] - _ARMIJO * length * decrease
        _assign(best.end, active[is_accepted], _subset(trial, is_accepted))
        active, direction, decrease, length = (
            active[~is_accepted],
            direction[~is_accepted],
            decrease[~is_accepted],
            _BACK * length[~is_accepted],
        )


def _normalise(problem: SmoothedDual, y: np.ndarray) -> np.ndarray:
    return y / (y @ problem.e)[:, None]


def _max_step(problem: SmoothedDual, y: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """How far (N,), at most 1, y stays well within Z > 0 and mu > 0."""
    root = np.linalg.inv(np.linalg.cholesky(problem.Z(y)))
    shares = np.linalg.eigvalsh(root @ problem.Z(direction) @ root.swapaxes(-1, -2))[..., 0].min(axis=1)
    entries = problem.entries
    shares = np.minimum(shares, (direction[:, entries:] / y[:, entries:]).min(axis=1, initial=0.0))
    return np.minimum(1.0, _STEP_SHARE / np.maximum(-shares, 1e-300))


def _subset(points: DualPoints, which: np.ndarray) -> DualPoints:
    return DualPoints(points.y[which], points.f[which], points.bound[which], points.shares[which])


def _assign(points: DualPoints, rows: np.ndarray, values: DualPoints) -> None:
    points.y[rows], points.f[rows], points.bound[rows], points.shares[rows] = values.y, values.f, values.bound, values.shares


def branch_decreases(problem: SmoothedDual, points: DualPoints, allowed: np.ndarray) -> np.ndarray:
    """Return by how much f falls (N, K, A), to second order, where a layer takes a step: inf where it is not allowed.

    The others' optimum moves by H^-1 (d - mean): -tau log share + (d - mean)'H^-1 (d - mean) / 2.
    """
    local_model = quadratic_models(problem, points)
    root = np.linalg.inv(np.linalg.cholesky(local_model.H)) * local_model.size[:, None, :]
    N, c = points.y.shape
    shifts = (root @ problem.flat.T).reshape(N, c, *allowed.shape[1:]) - (root @ local_model.mean.swapaxes(1, 2))[..., None]
    shares = np.maximum(points.shares, np.finfo(float).tiny)
    return np.where(allowed, np.sum(shifts**2, axis=1) / 2 - problem.tau * np.log(shares), np.inf)
