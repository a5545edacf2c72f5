"""A selection problem in the form that every method works on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.rules.abstract import Resource
from obsdesign.selection.double_double import Pair
from obsdesign.selection.extended_sums import exact_sums
from obsdesign.selection.pricing.abstract import AbstractSchedules
from obsdesign.selection.relaxation.dual import Dual
from obsdesign.selection.scaled_criterion import Judge

_EPS = float(np.finfo(float).eps)
_NEGLIGIBLE = 1e-11  # of a bound: rounding that is not worth a word
_AT_A_TIME = 1_000_000  # entries of blocks that are added in twice the digits


@dataclass(frozen=True, eq=False)
class Instance:
    """max min_r criterion(known + sum_ks kept_rs on_ks W_ks) - switching over the schedules that keep every rule.

    In units in which all sensors together know about one of each state, V = D W D with powers of two D: what is small in the user's
    units is not lost beside what is large. rows (K, S, d): blocks V_ks as vectors, d = n (n + 1) / 2, off the diagonal times sqrt 2,
    so that <V, Z> is a product of vectors. known (n, n): what is there without a sensor, likewise in these units. kept (R, S): which
    sensors work in each of the R scenarios of loss; a row of ones where none is lost. switching (S,). given (K, S, n, n): the blocks as
    the user has them. Values are the user's.
    """

    rows: np.ndarray
    given: np.ndarray
    n: int
    judge: Judge
    schedules: AbstractSchedules
    resources: tuple[Resource, ...]
    switching: np.ndarray
    kept: np.ndarray
    known: np.ndarray

    @property
    def criterion(self) -> AbstractCriterion:
        """What is maximised."""
        return self.judge.criterion

    @property
    def shape(self) -> tuple[int, int]:
        """(K, S)."""
        return self.rows.shape[0], self.rows.shape[1]

    @cached_property
    def limits(self) -> np.ndarray:
        """Limits of the resources."""
        return np.array([resource.limit for resource in self.resources])

    @cached_property
    def blocks(self) -> np.ndarray:
        """What a schedule may add up (K S + 1, n, n): V_ks, and what is known last; rows lose a bit off the diagonal."""
        K, S = self.shape
        own = self.given.reshape(K * S, self.n, self.n) * self.judge.D[:, None] * self.judge.D
        return np.concatenate([own, self.known[None]])

    @cached_property
    def everything(self) -> np.ndarray:
        """V (R, n, n) of all sensors that are ever available: more than any schedule has."""
        return self.information(self.schedules.available)

    def information(self, chosen: np.ndarray) -> np.ndarray:
        """V (R, n, n) in each scenario of loss."""
        if len(self.kept) == 1:  # in one piece, which is faster
            found = matrices((chosen * self.kept[0]).ravel() @ self.rows.reshape(chosen.size, -1), self.n)[None]
        else:
            by_sensor = np.stack([chosen[:, s].astype(float) @ self.rows[:, s] for s in range(self.shape[1])])
            found = matrices(self.kept @ by_sensor, self.n)
        return found + self.known

    def usage(self, chosen: np.ndarray) -> np.ndarray:
        """How much of every resource a schedule takes."""
        starts = started(chosen).sum(axis=0)
        return np.array([float(resource.usage[chosen].sum() + resource.start @ starts) for resource in self.resources])

    def penalty(self, chosen: np.ndarray) -> float:
        """What switching takes off the value."""
        return float(self.switching @ started(chosen).sum(axis=0)) if self.switching.any() else 0.0

    def value(self, chosen: np.ndarray) -> float:
        """What a schedule is worth."""
        return float(self.values(chosen[None], self.information(chosen)[None])[0]) - self.penalty(chosen)

    def values(self, chosen: np.ndarray, V: np.ndarray) -> np.ndarray:
        """min_r criterion of schedules (N, K, S) with information V (N, R, n, n): a direction that no block sees counts as hidden.

        Where double precision does not tell, the blocks are added in twice the digits.
        """
        found = np.empty(V.shape[:2])
        for r, kept in enumerate(self.kept):
            found[:, r], sure = self.judge.quick(V[:, r])
            for part in _parts(np.flatnonzero(~sure), _AT_A_TIME // self.blocks[..., 0].size) if not sure.all() else ():
                on = (chosen[part] * kept).reshape(len(part), -1) > 0
                on = np.column_stack([on, np.ones(len(part), dtype=bool)])
                found[part, r] = self.judge.refined(self._exactly(on), self.blocks, on)
        return found.min(axis=1)

    def hidden(self, chosen: np.ndarray) -> np.ndarray:
        """Return directions of the state (R, n), in the user's units, that a schedule does not see in each scenario of loss; 0: none."""
        V, found = self.information(chosen), np.zeros((len(self.kept), self.n))
        for r, kept in enumerate(self.kept):
            (value,), (sure,) = self.judge.quick(V[r : r + 1])
            if not sure or value == self.judge.nothing:
                on = np.append((chosen * kept).ravel() > 0, True)[None]
                unseen = self.judge.hidden(self._exactly(on), self.blocks, on)
                if unseen.size:
                    found[r] = self.judge.D * unseen[:, 0]
        return found

    def _exactly(self, on: np.ndarray) -> Pair:
        rows, columns = np.tril_indices(self.n)
        sums = exact_sums(self.blocks[:, rows, columns], on)
        found = np.zeros((self.n, self.n, len(on))), np.zeros((self.n, self.n, len(on)))
        for part, total in zip(found, sums, strict=True):
            part[rows, columns] = part[columns, rows] = total.T
        return found

    def judged(self, V: np.ndarray) -> float:
        """min_r criterion(V_r) of mixtures V (R, n, n)."""
        return float(self.judge.values(V).min())

    def keeps_limits(self, chosen: np.ndarray) -> bool:
        """Whether no resource is exceeded, but for rounding."""
        return bool((self.usage(chosen) <= self.limits + 1e-9 * np.maximum(1.0, self.limits)).all())

    def prices(self, dual: Dual) -> tuple[np.ndarray, np.ndarray]:
        """What each sensor in each segment (K, S) is worth, and what each switching-on (S,) costs."""
        K, S = self.shape
        z = self.kept.T @ vectors(dual.Z)
        if len(self.kept) == 1:  # in one piece, which is faster
            price = (self.rows.reshape(K * S, -1) @ vectors(dual.Z[0])).reshape(K, S) * self.kept[0]
        else:
            price = np.stack([self.rows[:, s] @ z[s] for s in range(S)], axis=1)
        np.maximum(price, 0.0, out=price)  # information is worth at least nothing: what is negative is a rounding error
        start = self.switching.copy()
        for mu, resource in zip(dual.mu, self.resources, strict=True):
            if mu > 0:
                price -= mu * resource.usage
                start += mu * resource.start
        return price, start

    def constant(self, dual: Dual) -> float:
        """What a bound has beside what is added up: what is known, and the worth of the best schedule."""
        return dual.offset + float(dual.mu @ self.limits)

    def ground(self, dual: Dual) -> float:
        """What a bound has beside the worth of the best schedule."""
        return self.constant(dual) + float(np.sum(dual.Z * self.known))

    def slack(self, dual: Dual, level: float) -> float:
        """What rounding may take off a bound near a level: 4 eps sum_r sum_ij sqrt(V_ii V_jj) |Z_ij|, V of all sensors; 0 if negligible."""
        sizes = np.sqrt(np.maximum(np.diagonal(self.everything, axis1=1, axis2=2), 0.0))
        found = 4 * _EPS * float(np.einsum("ri,rij,rj->", sizes, np.abs(dual.Z), sizes))
        return found if found > _NEGLIGIBLE * abs(level) else 0.0

    def theirs(self, Z: np.ndarray) -> np.ndarray:
        """Return a dual Z (R, n, n) in the user's units, <V, Z> = <W, theirs(Z)>."""
        return Z * self.judge.D[:, None] * self.judge.D

    def ours(self, Z: np.ndarray) -> np.ndarray:
        """Return a dual in the user's units (R, n, n) as one in the units of this problem."""
        return Z / self.judge.D[:, None] / self.judge.D


def _parts(indices: np.ndarray, most: int) -> list[np.ndarray]:
    return np.array_split(indices, -(-len(indices) // max(most, 1)))


def started(chosen: np.ndarray) -> np.ndarray:
    """Where (K, S) a sensor is switched on; all are off before the first segment."""
    before = np.zeros_like(chosen)
    before[1:] = chosen[:-1]
    return chosen & ~before


def vectors(W: np.ndarray) -> np.ndarray:
    """Return symmetric matrices (..., n, n) as vectors (..., n (n + 1) / 2) with the same inner product."""
    rows, columns, weights = _triangle(W.shape[-1])
    return W[..., rows, columns] * weights


def matrices(values: np.ndarray, n: int) -> np.ndarray:
    """Return the symmetric matrices (..., n, n) of vectors."""
    rows, columns, weights = _triangle(n)
    W = np.empty((*values.shape[:-1], n, n))
    W[..., rows, columns] = W[..., columns, rows] = values / weights
    return W


@lru_cache(32)
def _triangle(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rows, columns = np.tril_indices(n)
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))
