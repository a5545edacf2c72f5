"""A criterion of what sums of blocks say about the judged states, in units in which every state is known about equally well."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.selection.double_double import DoubleDouble
from obsdesign.selection.extended_sums import covariance_roots, doubtful_directions, ldl_factor, unseen_direction

_MIN_PIVOT = 1e-6  # pivots of a sum B with unit sizes, and 1 / tr B^-1, above which double precision leaves eight digits and more
_MIN_EIGENVALUE_RATIO = 1e-5  # a ratio of eigenvalues above which units do not matter
_RIDGE, _NOISE = 1e-13, 1e-14  # what keeps unseen nuisance states apart from 0: of a sum, and of all sensors, as exchanges leave round-off
_MIN_METRIC_SHARE = 1e-10  # of the largest: what a state's share in a smallest eigenvalue counts at least in a search


@dataclass(frozen=True, eq=False)
class ScaledCriterion:
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
        weights = np.zeros(len(self.D))
        weights[self.about] = self.D[self.about] ** 2
        return weights

    def value(self, V: np.ndarray) -> float:
        """The criterion of V (n, n)."""
        return float(self.values(V[None])[0])

    def values(self, V: np.ndarray) -> np.ndarray:
        """The criterion of each V (N, n, n), a direction below the round-off of its sizes counting as hidden."""
        results, is_accurate = self.values_in_double(V)
        if not is_accurate.all():
            unsure = np.moveaxis(V[~is_accurate], 0, 2)
            results[~is_accurate] = self.values_in_extended((unsure, np.zeros_like(unsure)), None, None)
        return results

    def values_in_double(self, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The criterion of each V (N, n, n) in double precision, and which of the numbers are good to eight digits."""
        if self.criterion.is_smallest_eigenvalue and not len(self.nuisance):
            unit = 1 / self.D
            values = np.linalg.eigvalsh(V * unit[:, None] * unit)
            smallest, is_accurate = values[:, 0], values[:, 0] > _MIN_EIGENVALUE_RATIO * values[:, -1]
            if is_accurate.all():
                return smallest, is_accurate
            smallest[~is_accurate], is_accurate[~is_accurate] = self._values_by_cholesky(V[~is_accurate])
            return smallest, is_accurate
        return self._values_by_cholesky(V)

    def _values_by_cholesky(self, V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        first = len(self.nuisance)
        V = V[:, self.order[:, None], self.order] if first else V
        sizes = np.diagonal(V, axis1=1, axis2=2)
        d = np.sqrt(np.where(sizes > 0, sizes, 1.0))
        is_blind = (sizes[:, first:] <= 0).any(axis=1)
        B = V / d[:, :, None] / d[:, None, :] + np.eye(len(self.D)) * (sizes <= 0)[:, :, None]
        L, is_accurate = _cholesky(B)
        inverse = np.linalg.inv(L)  # rounding of B takes about eps tr B^-1 off its digits, also where no single pivot is small
        is_accurate &= np.sum(inverse**2, axis=(1, 2)) <= 1 / _MIN_PIVOT
        R = inverse[:, first:, first:] * (self.D[self.about] / d[:, first:])[:, None, :]
        results = self.criterion.value_from_root(R)
        results[is_blind] = self.hidden_value
        return results, is_accurate | is_blind

    @property
    def hidden_value(self) -> float:
        """The value of what leaves a direction hidden."""
        return 0.0 if self.criterion.is_smallest_eigenvalue else -np.inf

    def values_in_extended(self, V: DoubleDouble, blocks: np.ndarray | None, on: np.ndarray | None) -> np.ndarray:
        """The criterion of each V (n, n, N), in twice the digits; hidden is what no block (M, n, n) that is on (N, M) sees."""
        R, sees, _, hidden = self._examine(V, blocks, on)
        results = self.criterion.value_from_root(R * self.D[self.about])
        results[~sees | hidden.any(axis=1)] = self.hidden_value
        return results

    def hidden_directions(self, V: DoubleDouble, blocks: np.ndarray, on: np.ndarray) -> np.ndarray:
        """Return the directions (n, p) that no block (M, n, n) that is on (1, M) sees, of V (n, n, 1)."""
        _, _, directions, hidden = self._examine(V, blocks, on)
        unseen = np.zeros((len(self.D), int(hidden[0].sum())))
        unseen[self.order] = directions[0][:, hidden[0]]
        return unseen

    def _examine(
        self, V: DoubleDouble, blocks: np.ndarray | None, on: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Roots (N, k, k), which of them (N,) there are, directions (N, n, k) and which of these (N, k) are hidden."""
        first = len(self.nuisance)
        ordered = None if blocks is None else blocks[:, self.order[:, None], self.order]
        factors = ldl_factor(V, self.order, first, ordered, on)
        R, sees = covariance_roots(factors, first)
        directions, doubtful = doubtful_directions(factors, first)
        if ordered is not None and on is not None:
            judged = np.arange(len(self.D)) >= first
            for i, p in np.argwhere(doubtful):
                unseen = unseen_direction(ordered[on[i]], directions[i, :, p], judged)
                doubtful[i, p] = unseen is not None
                directions[i, :, p] = directions[i, :, p] if unseen is None else unseen
        return R, sees, directions, doubtful

    # ------------------------------------------------------------ slopes

    def tangent(self, V: np.ndarray) -> tuple[np.ndarray, float]:
        """Return Z (n, n) and an offset with value(V') <= <V', Z> + offset for every V', and equality at V."""
        lift = self.lift(V)
        S = self._to_user_units(self.schur_complement(V, lift))
        Y = self.criterion.slope(S)
        user = lift / self.D[self.about]
        return user @ Y @ user.T, self.value(V) - float(np.sum(Y * S))

    def curvature(self, V: np.ndarray, changes: np.ndarray) -> np.ndarray:
        """Return -d2 value (q, q) along changes (q, n, n) at V."""
        lift = self.lift(V)
        S = self._to_user_units(self.schur_complement(V, lift))
        result = self.criterion.curvature(S, self._to_user_units(lift.T @ changes @ lift))
        if len(self.nuisance):  # S falls by the square of what a change adds between judged and nuisance states
            user = lift / self.D[self.about]
            nuisance_block = V[np.ix_(self.nuisance, self.nuisance)]
            coupling = (changes @ user)[:, self.nuisance]
            response = np.linalg.lstsq(nuisance_block, np.concatenate(list(coupling), axis=1), rcond=1e-13)[0]
            response = response.reshape(len(self.nuisance), len(changes), -1).swapaxes(0, 1)
            result = result + 2 * np.einsum("iba,jbc,ca->ij", coupling, response, self.criterion.slope(S))
        return result

    def lift(self, V: np.ndarray) -> np.ndarray:
        """Return (n, k): how the nuisance states follow the judged ones; S = lift' V lift."""
        lift_matrix = np.zeros((len(self.D), len(self.about)))
        lift_matrix[self.about, np.arange(len(self.about))] = 1.0
        if len(self.nuisance):
            nuisance_block, cross_block = V[np.ix_(self.nuisance, self.nuisance)], V[np.ix_(self.nuisance, self.about)]
            size = np.sqrt(np.where(np.diag(nuisance_block) > 0, np.diag(nuisance_block), 1.0))
            response = np.linalg.lstsq(nuisance_block / np.outer(size, size), cross_block / size[:, None], rcond=1e-14)[0]
            lift_matrix[self.nuisance] = -response / size[:, None]
        return lift_matrix

    def schur_complement(self, V: np.ndarray, lift: np.ndarray) -> np.ndarray:
        """Return lift' V lift (k, k)."""
        S = lift.T @ V @ lift if len(self.nuisance) else V[np.ix_(self.about, self.about)]
        return (S + S.T) / 2

    def _to_user_units(self, S: np.ndarray) -> np.ndarray:
        unit = 1 / self.D[self.about]
        return S * unit[:, None] * unit

    # ------------------------------------------------------------ searching

    @cached_property
    def search_units(self) -> np.ndarray:
        """Units (k,) of the judged states for a search: those of the user, but for states that are known much too well to count."""
        metric = self.metric[self.about]
        return 1 / np.sqrt(np.maximum(metric, _MIN_METRIC_SHARE * metric.max()))

    def search_information(self, V: np.ndarray) -> np.ndarray:
        """Return S (..., k, k) of V (..., n, n) in the units of a search."""
        a, b = self.about, self.nuisance
        S = V[..., a[:, None], a]
        if len(b):
            nuisance_block, cross_block = V[..., b[:, None], b], V[..., b[:, None], a]
            ridge = np.maximum(_RIDGE * np.trace(nuisance_block, axis1=-2, axis2=-1), _NOISE)[..., None, None]
            S = S - cross_block.swapaxes(-1, -2) @ np.linalg.solve(nuisance_block + ridge * np.eye(len(b)), cross_block)
        return S * self.search_units[:, None] * self.search_units


def _cholesky(B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The factors of B (N, n, n) with unit diagonals, and which of them are far from singular; I in place of the others."""
    try:
        L = np.linalg.cholesky(B)
    except np.linalg.LinAlgError:
        L = np.zeros_like(B) + np.eye(B.shape[1])
        is_accurate = np.linalg.eigvalsh(B)[:, 0] >= _MIN_PIVOT
        L[is_accurate] = np.linalg.cholesky(B[is_accurate])
        return L, is_accurate
    return L, (np.diagonal(L, axis1=1, axis2=2) ** 2).min(axis=1) >= _MIN_PIVOT
