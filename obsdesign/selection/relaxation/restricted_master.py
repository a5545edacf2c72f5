"""The best mixture of a few schedules, and the prices that say what would improve it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import clarabel as _untyped
import numpy as np
from scipy import sparse

from obsdesign.selection.problem import Instance
from obsdesign.selection.relaxation.dual import Dual

clarabel: Any = _untyped  # its stubs leave out what it has
_ACCEPTED = ("Solved", "AlmostSolved")


@dataclass(frozen=True, eq=False)
class Column:
    """A schedule as a mixture sees it: W (R, n, n), usage (resources,), what switching takes off.

    chosen (K, S), or the steps of a walk through what is undecided.
    """

    chosen: np.ndarray
    W: np.ndarray
    usage: np.ndarray
    penalty: float


@dataclass(frozen=True, eq=False)
class Mixture:
    """Shares (J,) of the columns, the value of the mixture, and the dual it leads to."""

    shares: np.ndarray
    value: float
    dual: Dual
    multipliers: np.ndarray = field(repr=False)


def column_of(instance: Instance, chosen: np.ndarray) -> Column:
    """Return a schedule as a column."""
    return Column(chosen, instance.information(chosen), instance.usage(chosen), instance.penalty(chosen))


def mixed(instance: Instance, columns: list[Column], before: Mixture | None) -> Mixture | None:
    """Return the best mixture, or None where the solver gives up. before: that of the first columns, where a climb begins."""
    if instance.criterion.is_smallest_eigenvalue:
        return _largest_eigenvalue(instance, columns)
    from obsdesign.selection.relaxation.master_newton import climbed

    return climbed(instance, columns, before)


def _largest_eigenvalue(instance: Instance, columns: list[Column]) -> Mixture | None:
    """max t - penalty'a over known + V_r(a) - t diag(metric) >= 0, usage'a <= limits, sum a = 1, a >= 0.

    Solved with unit diagonals of all columns together and t in units of 1 / max metric: the same problem, well conditioned. The columns
    contain what is known, so it is in every mixture.
    """
    J, R, n, m = len(columns), len(instance.kept), instance.n, len(instance.resources)
    W = np.stack([column.W for column in columns])
    D = _scales(W)
    unit, metric = _metric(instance, D)
    scaled = W * np.outer(D, D)
    cone = np.vstack([np.hstack([-clarabel_vectors(scaled[:, r]).T, clarabel_vectors(np.diag(metric))[:, None]]) for r in range(R)])
    usage = np.stack([column.usage for column in columns]).T if m else np.zeros((0, J))
    size = np.maximum(instance.limits, 1e-9 + np.abs(usage).max(axis=1, initial=0.0)) if m else np.zeros(0)
    rows = np.vstack([np.hstack([np.ones((1, J)), np.zeros((1, 1))]), np.hstack([-np.eye(J), np.zeros((J, 1))])])
    rows = np.vstack([rows, np.hstack([usage / size[:, None], np.zeros((m, 1))]), cone])
    sides = np.concatenate([[1.0], np.zeros(J), instance.limits / size, np.zeros(len(cone))])
    goal = np.append([column.penalty / unit for column in columns], -1.0)
    kinds = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(J + m), *(clarabel.PSDTriangleConeT(n) for _ in range(R))]
    found = solved(sparse.csc_matrix((J + 1, J + 1)), goal, rows, sides, kinds)
    if found is None:
        return None
    x, z = found
    size_of_Z = n * (n + 1) // 2
    Z = np.stack([clarabel_matrix(z[1 + J + m + r * size_of_Z :][:size_of_Z], n) for r in range(R)])
    Z = normalised(Z, metric) * np.outer(D, D) * unit
    mu = np.maximum(z[1 + J : 1 + J + m], 0.0) / size * unit if m else np.zeros(0)
    shares = np.maximum(x[:J], 0.0)
    shares /= shares.sum()
    value = instance.judged(np.tensordot(shares, W, 1)) - shares @ [column.penalty for column in columns]
    return Mixture(shares, float(value), Dual(Z, mu, 0.0), np.ones(R) / R)


def _scales(W: np.ndarray) -> np.ndarray:
    total = np.diagonal(W.sum(axis=(0, 1)))
    return 1 / np.sqrt(np.where(total > 0, total, 1.0)) * np.sqrt(len(W) * W.shape[1])


def _metric(instance: Instance, D: np.ndarray) -> tuple[float, np.ndarray]:
    """The unit of t, and what of each state counts in it (n,): at most 1 in units D."""
    metric = instance.judge.metric * D**2
    return 1 / float(metric.max()), metric / metric.max()


def normalised(Z: np.ndarray, metric: np.ndarray) -> np.ndarray:
    """The nearest Z_r >= 0 with sum <diag(metric), Z_r> = 1: what makes a bound of it whatever the solver returned."""
    values, vectors = np.linalg.eigh((Z + Z.swapaxes(1, 2)) / 2)
    positive = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.swapaxes(1, 2)
    total = float(np.sum(np.diagonal(positive, axis1=1, axis2=2) * metric))
    if not total > 0:
        positive = np.broadcast_to(np.diag((metric > 0).astype(float)), Z.shape)
        total = len(Z) * float(metric.sum())
    return positive / total


def solved(
    P: sparse.csc_matrix, goal: np.ndarray, rows: np.ndarray, sides: np.ndarray, kinds: list[Any]
) -> tuple[np.ndarray, np.ndarray] | None:
    """Minimise x'P x / 2 + goal'x, sides - rows x in the cones: x and the multipliers, or None where Clarabel gives up."""
    solver = clarabel.DefaultSolver(P, goal, sparse.csc_matrix(rows), sides, kinds, _settings())
    try:
        found = solver.solve()
    except BaseException as error:  # a panic of Rust is no Exception
        if type(error).__name__ == "PanicException":
            return None
        raise
    return (np.array(found.x), np.array(found.z)) if str(found.status) in _ACCEPTED else None


@lru_cache(1)
def _settings() -> Any:  # noqa: ANN401
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = 100
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    return settings


@lru_cache(16)
def _upper(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    columns, rows = np.tril_indices(n)  # of the transpose: column by column
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))


def clarabel_vectors(S: np.ndarray) -> np.ndarray:
    """Upper triangles of symmetric S (..., n, n), column by column, off the diagonal times sqrt 2."""
    rows, columns, weights = _upper(S.shape[-1])
    return S[..., rows, columns] * weights


def clarabel_matrix(values: np.ndarray, n: int) -> np.ndarray:
    """Return the symmetric matrix of an upper triangle."""
    rows, columns, weights = _upper(n)
    S = np.empty((n, n))
    S[rows, columns] = S[columns, rows] = values / weights
    return S
