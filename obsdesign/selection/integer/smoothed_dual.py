"""The dual of many partial schedules at a time, its corners rounded off: Newton's method on all of them together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from obsdesign.selection.integer.reduced_problem import ReducedProblem
from obsdesign.selection.problem import SelectionProblem, smat, svec

_EPS = float(np.finfo(float).eps)
_RIDGE = 1e-13  # on a unit diagonal: some hundred times the rounding of a double, so that its factor exists; steps bend by as little
_REACH = 0.9  # of the way to where Z is singular, at most
_ARMIJO, _BACK, _TRIALS = 0.1, 0.4, 5
_STILL = 0.02  # of tau: a decrease that is not worth a step


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Duals y = (Z_1, ..., Z_R, mu) (c,) of schedules that take one step of every layer, in units of a root bound.

    f(y) = base'y + tau sum_k log sum_p exp(adds_kp'y / tau) - tau (sum_r log det Z_r + sum log mu) over e'y = sum_r <E, Z_r> = 1.
    adds (K, A, c): information as vectors and minus usage, of at most A steps a layer, there (K, A) bool; base (c,): what is decided and
    known, and limits less what is decided takes; sizes (n,): square roots of the diagonal of all information.
    As tau falls to 0, f falls to UB(y) = base'y + sum_k max_p adds_kp'y, which is a bound for every y with Z_r >= 0, mu >= 0.
    """

    adds: np.ndarray
    there: np.ndarray
    base: np.ndarray
    e: np.ndarray
    sizes: np.ndarray
    scenarios: int
    tau: float

    def of_tau(self, tau: float) -> Smoothed:
        """Return the same with corners rounded off as much."""
        return replace(self, tau=tau)

    @property
    def n(self) -> int:
        return len(self.sizes)

    @cached_property
    def flat(self) -> np.ndarray:
        """adds (K A, c)."""
        return self.adds.reshape(-1, self.adds.shape[2])

    @cached_property
    def products(self) -> np.ndarray:
        """The products (K A, c (c + 1) / 2) of any two entries of each step."""
        i, j = np.tril_indices(self.adds.shape[2])
        return self.flat[:, i] * self.flat[:, j]

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
class Points:
    """Where duals y (N, c) are: f (N,), bounds (N,), shares of the steps (N, K, A)."""

    y: np.ndarray
    f: np.ndarray
    bound: np.ndarray
    shares: np.ndarray


@dataclass(frozen=True, eq=False)
class Model:
    """f to second order at points: gradient (N, c), H (N, c, c) in units size (N, c), mean (N, K, c) of what each layer adds."""

    gradient: np.ndarray
    H: np.ndarray
    size: np.ndarray
    mean: np.ndarray


@dataclass(frozen=True, eq=False)
class Descent:
    """Where descents end, and the best duals (N, c) met on the way, with their bounds (N,)."""

    end: Points
    dual: np.ndarray
    bound: np.ndarray


def smoothed(instance: SelectionProblem, walks: ReducedProblem, unit: float) -> Smoothed:
    """Return the dual of what is undecided in segments without links, in units of a bound."""
    most = max(len(layer.increments) for layer in walks.layers)
    R, m = len(instance.working_sensors), len(instance.resources)
    adds = np.zeros((len(walks.layers), most, len(walks.base) - 1))
    there = np.zeros(adds.shape[:2], dtype=bool)
    for k, layer in enumerate(walks.layers):
        adds[k, : len(layer.increments)] = layer.increments[:, :-1]
        there[k, : len(layer.increments)] = True
    base = walks.base[:-1].copy()
    entries = len(base) - m
    adds[..., entries:] *= -1.0
    base[entries:] = instance.limits + 1e-9 * np.maximum(1.0, instance.limits) - base[entries:]  # as everywhere
    most_used = np.maximum(np.abs(base[entries:]), np.abs(adds[..., entries:]).max(axis=(0, 1), initial=0.0))
    size = np.concatenate([np.full(entries, unit), np.where(most_used > 0, most_used, 1.0)])
    adds, base = adds / size, base / size
    e = np.concatenate([np.tile(svec(np.diag(instance.scaled_criterion.metric)), R), np.zeros(m)])
    sizes = np.sqrt(np.maximum(np.diagonal(instance.all_information, axis1=1, axis2=2).max(axis=0), 0.0) / unit)
    return Smoothed(adds, there, base, e, sizes, R, 1.0)


def at(problem: Smoothed, y: np.ndarray, allowed: np.ndarray) -> Points:
    """Evaluate duals y (N, c) of what is allowed (N, K, A)."""
    scores = problem.scores(y, allowed)
    best = scores.max(axis=2)
    shares = np.exp((scores - best[:, :, None]) / problem.tau)
    total = shares.sum(axis=2)
    mu = y[:, problem.entries :]
    barrier = np.linalg.slogdet(problem.Z(y))[1].sum(axis=1) + np.log(mu).sum(axis=1)
    f = y @ problem.base + best.sum(axis=1) + problem.tau * (np.log(total).sum(axis=1) - barrier)
    return Points(y, f, problem.bounds(y, best), shares / total[:, :, None])


def model(problem: Smoothed, points: Points) -> Model:
    """Return the second-order model of f at points."""
    N, c = points.y.shape
    tau, entries, shares = problem.tau, problem.entries, points.shares
    inverse = np.linalg.inv(problem.Z(points.y))
    mu = points.y[:, entries:]
    mean = np.matmul(shares.swapaxes(0, 1), problem.adds).swapaxes(0, 1)
    barrier = np.concatenate([svec(inverse).reshape(N, entries), 1 / mu], axis=1)
    i, j = np.tril_indices(c)
    H = np.empty((N, c, c))
    H[:, i, j] = H[:, j, i] = shares.reshape(N, -1) @ problem.products
    rounding = 4 * c * _EPS * np.diagonal(H, axis1=1, axis2=2)[:, :, None] * np.eye(c)
    H = (H + rounding - mean.swapaxes(1, 2) @ mean) / tau
    d = entries // problem.scenarios
    basis = smat(np.eye(d), problem.n)
    for r in range(problem.scenarios):
        own = slice(r * d, (r + 1) * d)
        H[:, own, own] += tau * svec(inverse[:, None, r] @ basis @ inverse[:, None, r])
    rest = np.arange(entries, c)
    H[:, rest, rest] += tau / mu**2
    size = 1 / np.sqrt(np.diagonal(H, axis1=1, axis2=2))
    scaled = H * size[:, :, None] * size[:, None, :] + _RIDGE * np.eye(c)
    return Model(problem.base + mean.sum(axis=1) - tau * barrier, scaled, size, mean)


def descended(problem: Smoothed, y: np.ndarray, allowed: np.ndarray, steps: int, least: float) -> Descent:
    """Take Newton steps from duals y (N, c) of what is allowed (N, K, A), until their bounds fall to `least` or f hardly falls."""
    end = at(problem, y, allowed)
    best = Descent(end, y.copy(), end.bound.copy())
    live = np.arange(len(y))
    for _ in range(steps):
        live = live[best.bound[live] > least]
        if not len(live):
            break
        direction, decrease = _direction(problem, _some(end, live))
        goes = decrease > _STILL * problem.tau
        live, direction, decrease = live[goes], direction[goes], decrease[goes]
        _search(problem, best, allowed, live, direction, decrease)
    return best


def _direction(problem: Smoothed, points: Points) -> tuple[np.ndarray, np.ndarray]:
    """Newton's directions (N, c) within e'y = const, and the decreases (N,) they promise."""
    here = model(problem, points)
    sides = np.stack([here.gradient * here.size, problem.e * here.size], axis=2)
    toward, across = np.moveaxis(np.linalg.solve(here.H, sides) * here.size[:, :, None], 2, 0)
    direction = across * ((toward @ problem.e) / (across @ problem.e))[:, None] - toward
    return direction, -np.sum(here.gradient * direction, axis=1)


def _search(problem: Smoothed, best: Descent, allowed: np.ndarray, live: np.ndarray, direction: np.ndarray, decrease: np.ndarray) -> None:
    """Move those that are live (M,) along their directions as far as f falls enough; in place."""
    length = _reach(problem, best.end.y[live], direction)
    for _ in range(_TRIALS):
        if not len(live):
            return
        there = at(problem, _of_unit(problem, best.end.y[live] + length[:, None] * direction), allowed[live])
        better = there.bound < best.bound[live]
        best.bound[live[better]], best.dual[live[better]] = there.bound[better], there.y[better]
        falls = there.f <= best.end.f[live] - _ARMIJO * length * decrease
        _put(best.end, live[falls], _some(there, falls))
        live, direction, decrease, length = live[~falls], direction[~falls], decrease[~falls], _BACK * length[~falls]


def _of_unit(problem: Smoothed, y: np.ndarray) -> np.ndarray:
    return y / (y @ problem.e)[:, None]


def _reach(problem: Smoothed, y: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """How far (N,), at most 1, y stays well within Z > 0 and mu > 0."""
    root = np.linalg.inv(np.linalg.cholesky(problem.Z(y)))
    shares = np.linalg.eigvalsh(root @ problem.Z(direction) @ root.swapaxes(-1, -2))[..., 0].min(axis=1)
    entries = problem.entries
    shares = np.minimum(shares, (direction[:, entries:] / y[:, entries:]).min(axis=1, initial=0.0))
    return np.minimum(1.0, _REACH / np.maximum(-shares, 1e-300))


def _some(points: Points, which: np.ndarray) -> Points:
    return Points(points.y[which], points.f[which], points.bound[which], points.shares[which])


def _put(points: Points, where: np.ndarray, what: Points) -> None:
    points.y[where], points.f[where], points.bound[where], points.shares[where] = what.y, what.f, what.bound, what.shares


def declines(problem: Smoothed, points: Points, allowed: np.ndarray) -> np.ndarray:
    """Return by how much f falls (N, K, A), to second order, where a layer takes a step: inf where it is not allowed.

    The others' optimum moves by H^-1 (adds - mean): -tau log share + (adds - mean)'H^-1 (adds - mean) / 2.
    """
    here = model(problem, points)
    root = np.linalg.inv(np.linalg.cholesky(here.H)) * here.size[:, None, :]
    N, c = points.y.shape
    moved = (root @ problem.flat.T).reshape(N, c, *allowed.shape[1:]) - (root @ here.mean.swapaxes(1, 2))[..., None]
    shares = np.maximum(points.shares, np.finfo(float).tiny)
    return np.where(allowed, np.sum(moved**2, axis=1) / 2 - problem.tau * np.log(shares), np.inf)
