"""A criterion of what sums of blocks say about the judged states, in units in which every state is known about equally well."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.selection.double_double import Pair
from obsdesign.selection.extended_sums import doubtful_directions, eliminated, roots, seen

_SURE = 1e-6  # pivots of a sum B with unit sizes, and 1 / tr B^-1, above which double precision leaves eight digits and more
_PLAIN = 1e-5  # a ratio of eigenvalues above which units do not matter
_RIDGE, _TINY = 1e-13, 1e-100  # what keeps unseen nuisance states apart from 0
_STIFF = 1e-10  # of the largest: what a state's share in a smallest eigenvalue counts at least in a search


@dataclass(frozen=True, eq=False)
class Judge:
    """criterion(S), S = W_aa - W_ab W_bb^-1 W_ba, of V = D W D for the judged states a.

    D (n,): powers of two, so that V has the digits of W. about (k,): indices of the judged states; the others are found as well.
    For a smallest eigenvalue value(V) = max t with V - t diag(metric) >= 0, hence value(V) <= <V, Z> for every Z >= 0 with
    <diag(metric), Z> = 1; metric = D^2 for judged states, 0 for others.
    """

    criterion: AbstractCriterion
    D: np.ndarray
    about: np.ndarray

    @cached_property
    def nuisance(self) -> np.ndarray:
        """Indices of the states that are not judged."""
        return np.setdiff1d(np.arange(len(self.D)), self.about)

    @cached_property
    def order(self) -> np.ndarray:
        """All states, the judged ones last."""
        return np.concatenate([self.nuisance, self.about])

    @cached_property
    def metric(self) -> np.ndarray:
        """(n,)."""
        found = np.zeros(len(self.D))
        found[self.about] = self.D[self.about] ** 2
        return found

    def value(self, V: np.ndarray) -> float:
        """The criterion of V (n, n)."""
        return float(self.values(V[None])[0])

    def values(self, V: np.ndarray) -> np.ndarray:
        """The criterion of each V (N, n, n), a direction below the round-off of its sizes counting as hidden."""
        found, sure = self.quick(V)
        if not sure.all():
            unsure = np.moveaxis(V[~sure], 0, 2)
            found[~sure] = self.refined((unsure, np.zeros_like(unsure)), None, None)
        return found

    def quick(self, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The criterion of each V (N, n, n) in double precision, and which of the numbers are good to eight digits."""
        if self.criterion.is_smallest_eigenvalue and not len(self.nuisance):
            unit = 1 / self.D
            values = np.linalg.eigvalsh(V * unit[:, None] * unit)
            found, sure = values[:, 0], values[:, 0] > _PLAIN * values[:, -1]
            if sure.all():
                return found, sure
            found[~sure], sure[~sure] = self._balanced(V[~sure])
            return found, sure
        return self._balanced(V)

    def _balanced(self, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        first = len(self.nuisance)
        V = V[:, self.order[:, None], self.order] if first else V
        sizes = np.diagonal(V, axis1=1, axis2=2)
        d = np.sqrt(np.where(sizes > 0, sizes, 1.0))
        dead = (sizes[:, first:] <= 0).any(axis=1)
        B = V / d[:, :, None] / d[:, None, :] + np.eye(len(self.D)) * (sizes <= 0)[:, :, None]
        L, sure = _cholesky(B)
        inverse = np.linalg.inv(L)  # rounding of B takes about eps tr B^-1 off its digits, also where no single pivot is small
        sure &= np.sum(inverse**2, axis=(1, 2)) <= 1 / _SURE
        R = inverse[:, first:, first:] * (self.D[self.about] / d[:, first:])[:, None, :]
        found = self.criterion.of_root(R)
        found[dead] = self.nothing
        return found, sure | dead

    @property
    def nothing(self) -> float:
        """The value of what leaves a direction hidden."""
        return 0.0 if self.criterion.is_smallest_eigenvalue else -np.inf

    def refined(self, V: Pair, blocks: np.ndarray | None, on: np.ndarray | None) -> np.ndarray:
        """The criterion of each V (n, n, N), in twice the digits; hidden is what no block (M, n, n) that is on (N, M) sees."""
        R, sees, _, hidden = self._examined(V, blocks, on)
        found = self.criterion.of_root(R * self.D[self.about])
        found[~sees | hidden.any(axis=1)] = self.nothing
        return found

    def hidden(self, V: Pair, blocks: np.ndarray, on: np.ndarray) -> np.ndarray:
        """Return the directions (n, p) that no block (M, n, n) that is on (1, M) sees, of V (n, n, 1)."""
        _, _, directions, hidden = self._examined(V, blocks, on)
        found = np.zeros((len(self.D), int(hidden[0].sum())))
        found[self.order] = directions[0][:, hidden[0]]
        return found

    def _examined(self, V: Pair, blocks: np.ndarray | None, on: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Roots (N, k, k), which of them (N,) there are, directions (N, n, k) and which of these (N, k) are hidden."""
        first = len(self.nuisance)
        factors = eliminated(V, self.order, first)
        R, sees = roots(factors, first)
        directions, doubtful = doubtful_directions(factors, R, first)
        if blocks is not None and on is not None and doubtful.any():
            some = doubtful.any(axis=1)
            doubtful[some] &= ~seen(blocks[:, self.order[:, None], self.order], on[some], directions[some])
        return R, sees, directions, doubtful

    # ------------------------------------------------------------ slopes

    def tangent(self, V: np.ndarray) -> tuple[np.ndarray, float]:
        """Return Z (n, n) and an offset with value(V') <= <V', Z> + offset for every V', and equality at V."""
        lift = self.lift(V)
        S = self._own(self.shadow(V, lift))
        Y = self.criterion.slope(S)
        user = lift / self.D[self.about]
        return user @ Y @ user.T, self.value(V) - float(np.sum(Y * S))

    def curvature(self, V: np.ndarray, changes: np.ndarray) -> np.ndarray:
        """Return -d2 value (q, q) along changes (q, n, n) at V."""
        lift = self.lift(V)
        S = self._own(self.shadow(V, lift))
        found = self.criterion.curvature(S, self._own(lift.T @ changes @ lift))
        if len(self.nuisance):  # S falls by the square of what a change adds between judged and nuisance states
            user = lift / self.D[self.about]
            known = V[np.ix_(self.nuisance, self.nuisance)]
            crossed = (changes @ user)[:, self.nuisance]
            solved = np.linalg.lstsq(known, np.concatenate(list(crossed), axis=1), rcond=1e-13)[0]
            solved = solved.reshape(len(self.nuisance), len(changes), -1).swapaxes(0, 1)
            found = found + 2 * np.einsum("iba,jbc,ca->ij", crossed, solved, self.criterion.slope(S))
        return found

    def lift(self, V: np.ndarray) -> np.ndarray:
        """Return (n, k): how the nuisance states follow the judged ones; S = lift' V lift."""
        found = np.zeros((len(self.D), len(self.about)))
        found[self.about, np.arange(len(self.about))] = 1.0
        if len(self.nuisance):
            known, mixed = V[np.ix_(self.nuisance, self.nuisance)], V[np.ix_(self.nuisance, self.about)]
            size = np.sqrt(np.where(np.diag(known) > 0, np.diag(known), 1.0))
            solved = np.linalg.lstsq(known / np.outer(size, size), mixed / size[:, None], rcond=1e-14)[0]
            found[self.nuisance] = -solved / size[:, None]
        return found

    def shadow(self, V: np.ndarray, lift: np.ndarray) -> np.ndarray:
        """Return lift' V lift (k, k)."""
        S = lift.T @ V @ lift if len(self.nuisance) else V[np.ix_(self.about, self.about)]
        return (S + S.T) / 2

    def _own(self, S: np.ndarray) -> np.ndarray:
        unit = 1 / self.D[self.about]
        return S * unit[:, None] * unit

    # ------------------------------------------------------------ searching

    @cached_property
    def stiff(self) -> np.ndarray:
        """Units (k,) of the judged states for a search: those of the user, but for states that are known much too well to count."""
        metric = self.metric[self.about]
        return 1 / np.sqrt(np.maximum(metric, _STIFF * metric.max()))

    def softened(self, V: np.ndarray) -> np.ndarray:
        """Return S (..., k, k) of V (..., n, n) in the units of a search."""
        a, b = self.about, self.nuisance
        S = V[..., a[:, None], a]
        if len(b):
            known, mixed = V[..., b[:, None], b], V[..., b[:, None], a]
            ridge = np.maximum(_RIDGE * np.trace(known, axis1=-2, axis2=-1), _TINY)[..., None, None]
            S = S - mixed.swapaxes(-1, -2) @ np.linalg.solve(known + ridge * np.eye(len(b)), mixed)
        return S * self.stiff[:, None] * self.stiff


def _cholesky(B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The factors of B (N, n, n) with unit diagonals, and which of them are far from singular; I in place of the others."""
    try:
        L = np.linalg.cholesky(B)
    except np.linalg.LinAlgError:
        L = np.zeros_like(B) + np.eye(B.shape[1])
        sure = np.linalg.eigvalsh(B)[:, 0] >= _SURE
        L[sure] = np.linalg.cholesky(B[sure])
        return L, sure
    return L, (np.diagonal(L, axis1=1, axis2=2) ** 2).min(axis=1) >= _SURE
