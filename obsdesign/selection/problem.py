"""A selection problem in the form that every method works on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from obsdesign.conic import smat, svec
from obsdesign.criteria.abstract import AbstractCriterion
from obsdesign.rules.abstract import AbstractRule, Resource, Segments, Terms
from obsdesign.selection.double_double import DoubleDouble
from obsdesign.selection.dual import Dual
from obsdesign.selection.extended_sums import exact_sums
from obsdesign.selection.pricing.abstract import AbstractSchedules
from obsdesign.selection.scaled_criterion import ScaledCriterion

_EPS = float(np.finfo(float).eps)
_NEGLIGIBLE = 1e-11  # of a bound: rounding that is not worth a word
_MAX_ENTRIES = 1_000_000  # entries of blocks that are added in twice the digits


@dataclass(frozen=True, eq=False)
class SelectionProblem:
    """max min_r criterion(known + sum_ks kept_rs on_ks W_ks) - switching over the schedules that keep every rule.

    In units in which all sensors together know about one of each state, V = D W D with powers of two D: what is small in the user's
    units is not lost beside what is large. block_vectors (K, S, d): blocks V_ks as vectors, d = n (n + 1) / 2, off the diagonal times sqrt
    2, so that <V, Z> is a product of vectors. known_information (n, n): what is there without a sensor, likewise in these units.
    working_sensors (R, S): which sensors work in each of the R scenarios of loss; a row of ones where none is lost. switching (S,).
    user_blocks (K, S, n, n): the blocks as the user has them. Values are the user's.
    """

    block_vectors: np.ndarray
    user_blocks: np.ndarray
    n: int
    scaled_criterion: ScaledCriterion
    schedules: AbstractSchedules
    resources: tuple[Resource, ...]
    switching: np.ndarray
    working_sensors: np.ndarray
    known_information: np.ndarray

    @property
    def criterion(self) -> AbstractCriterion:
        """What is maximised."""
        return self.scaled_criterion.criterion

    @property
    def shape(self) -> tuple[int, int]:
        """(K, S)."""
        return self.block_vectors.shape[0], self.block_vectors.shape[1]

    @cached_property
    def limits(self) -> np.ndarray:
        """Limits of the resources."""
        return np.array([resource.limit for resource in self.resources])

    @property
    def rounded_limits(self) -> np.ndarray:
        """What usages of resources (r,) may come to by rounding alone: 1e-9 above the limits, relative where these are above 1."""
        return self.limits + 1e-9 * np.maximum(1.0, self.limits)

    @cached_property
    def blocks(self) -> np.ndarray:
        """What a schedule may add up (K S + 1, n, n): V_ks, and what is known last; rows lose a bit off the diagonal."""
        K, S = self.shape
        scaled_blocks = self.user_blocks.reshape(K * S, self.n, self.n) * self.scaled_criterion.D[:, None] * self.scaled_criterion.D
        return np.concatenate([scaled_blocks, self.known_information[None]])

    @cached_property
    def all_information(self) -> np.ndarray:
        """V (R, n, n) of all sensors that are ever available: more than any schedule has."""
        return self.information(self.schedules.available)

    def information(self, chosen: np.ndarray) -> np.ndarray:
        """V (R, n, n) in each scenario of loss."""
        if len(self.working_sensors) == 1:  # in one piece, which is faster
            sums = smat((chosen * self.working_sensors[0]).ravel() @ self.block_vectors.reshape(chosen.size, -1), self.n)[None]
        else:
            by_sensor = np.stack([chosen[:, s].astype(float) @ self.block_vectors[:, s] for s in range(self.shape[1])])
            sums = smat(self.working_sensors @ by_sensor, self.n)
        return sums + self.known_information

    def usage(self, chosen: np.ndarray) -> np.ndarray:
        """How much of every resource a schedule takes."""
        switch_on_counts = switch_ons(chosen).sum(axis=0)
        return np.array([float(resource.usage[chosen].sum() + resource.start @ switch_on_counts) for resource in self.resources])

    def penalty(self, chosen: np.ndarray) -> float:
        """What switching takes off the value."""
        return float(self.switching @ switch_ons(chosen).sum(axis=0)) if self.switching.any() else 0.0

    def value(self, chosen: np.ndarray) -> float:
        """What a schedule is worth."""
        return float(self.values(chosen[None], self.information(chosen)[None])[0]) - self.penalty(chosen)

    def values(self, chosen: np.ndarray, V: np.ndarray) -> np.ndarray:
        """min_r criterion of schedules (N, K, S) with information V (N, R, n, n): a direction that no block sees counts as hidden.

        Where double precision does not tell, the blocks are added in twice the digits.
        """
        by_scenario = np.empty(V.shape[:2])
        for r, working in enumerate(self.working_sensors):
            by_scenario[:, r], is_accurate = self.scaled_criterion.values_in_double(V[:, r])
            for chunk in _chunks(np.flatnonzero(~is_accurate), _MAX_ENTRIES // self.blocks[..., 0].size) if not is_accurate.all() else ():
                on = (chosen[chunk] * working).reshape(len(chunk), -1) > 0
                on = np.column_stack([on, np.ones(len(chunk), dtype=bool)])
                by_scenario[chunk, r] = self.scaled_criterion.values_in_extended(self._sum_exactly(on), self.blocks, on)
        return by_scenario.min(axis=1)

    def hidden_directions(self, chosen: np.ndarray) -> np.ndarray:
        """Return directions of the state (R, n), in the user's units, that a schedule does not see in each scenario of loss; 0: none."""
        V, directions = self.information(chosen), np.zeros((len(self.working_sensors), self.n))
        for r, working in enumerate(self.working_sensors):
            (value,), (is_accurate,) = self.scaled_criterion.values_in_double(V[r : r + 1])
            if not is_accurate or value == self.scaled_criterion.hidden_value:
                on = np.append((chosen * working).ravel() > 0, True)[None]
                unseen = self.scaled_criterion.hidden_directions(self._sum_exactly(on), self.blocks, on)
                if unseen.size:
                    directions[r] = self.scaled_criterion.D * unseen[:, 0]
        return directions

    def _sum_exactly(self, on: np.ndarray) -> DoubleDouble:
        rows, columns = np.tril_indices(self.n)
        sums = exact_sums(self.blocks[:, rows, columns], on)
        pair = np.zeros((self.n, self.n, len(on))), np.zeros((self.n, self.n, len(on)))
        for part, total in zip(pair, sums, strict=True):
            part[rows, columns] = part[columns, rows] = total.T
        return pair

    def mixture_value(self, V: np.ndarray) -> float:
        """min_r criterion(V_r) of mixtures V (R, n, n)."""
        return float(self.scaled_criterion.values(V).min())

    def is_within_limits(self, chosen: np.ndarray) -> bool:
        """Whether no resource is exceeded, but for rounding."""
        return bool((self.usage(chosen) <= self.rounded_limits).all())

    def prices(self, dual: Dual) -> tuple[np.ndarray, np.ndarray]:
        """What each sensor in each segment (K, S) is worth, and what each switching-on (S,) costs."""
        K, S = self.shape
        z = self.working_sensors.T @ svec(dual.Z)
        if len(self.working_sensors) == 1:  # in one piece, which is faster
            price = (self.block_vectors.reshape(K * S, -1) @ svec(dual.Z[0])).reshape(K, S) * self.working_sensors[0]
        else:
            price = np.stack([self.block_vectors[:, s] @ z[s] for s in range(S)], axis=1)
        np.maximum(price, 0.0, out=price)  # information is worth at least nothing: what is negative is a rounding error
        return self.net_prices(price, dual.mu)

    def net_prices(self, worth: np.ndarray, prices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is left of the worth (K, S) of information at prices (resources,), and what each switching-on (S,) costs."""
        price, start = worth.copy(), self.switching.copy()
        for mu, resource in zip(prices, self.resources, strict=True):
            if mu > 0:
                price -= mu * resource.usage
                start += mu * resource.start
        return price, start

    def dual_constant(self, dual: Dual) -> float:
        """What a bound has beside what is added up: what is known, and the worth of the best schedule."""
        return dual.offset + float(dual.mu @ self.limits)

    def base_bound(self, dual: Dual) -> float:
        """What a bound has beside the worth of the best schedule."""
        return self.dual_constant(dual) + float(np.sum(dual.Z * self.known_information))

    def slack(self, dual: Dual, level: float) -> float:
        """What rounding may take off a bound near a level: 4 eps sum_r sum_ij sqrt(V_ii V_jj) |Z_ij|, V of all sensors; 0 if negligible."""
        sizes = np.sqrt(np.maximum(np.diagonal(self.all_information, axis1=1, axis2=2), 0.0))
        rounding = 4 * _EPS * float(np.einsum("ri,rij,rj->", sizes, np.abs(dual.Z), sizes))
        return rounding if rounding > _NEGLIGIBLE * abs(level) else 0.0

    def to_user_units(self, Z: np.ndarray) -> np.ndarray:
        """Return a dual Z (R, n, n) in the user's units, <V, Z> = <W, theirs(Z)>."""
        return Z * self.scaled_criterion.D[:, None] * self.scaled_criterion.D

    def from_user_units(self, Z: np.ndarray) -> np.ndarray:
        """Return a dual in the user's units (R, n, n) as one in the units of this problem."""
        return Z / self.scaled_criterion.D[:, None] / self.scaled_criterion.D


def _chunks(indices: np.ndarray, size: int) -> list[np.ndarray]:
    return np.array_split(indices, -(-len(indices) // max(size, 1)))


def switch_ons(chosen: np.ndarray, on_before: np.ndarray | None = None) -> np.ndarray:
    """Where (K, S) a sensor is switched on; on_before (S,): what is on before the first segment, None = nothing."""
    before = np.zeros_like(chosen)
    before[1:] = chosen[:-1]
    if on_before is not None:
        before[:1] = on_before
    return chosen & ~before


def switching_prices(terms: Sequence[Terms], sensors: int) -> np.ndarray:
    """What it costs to switch each of so many sensors on (S,): the sum over rules."""
    return np.sum([np.zeros(sensors), *(term.switching for term in terms if term.switching is not None)], axis=0)


def switching_cost(rules: Sequence[AbstractRule], segments: Segments, chosen: np.ndarray) -> float:
    """What the switching-ons of a schedule (K, S) cost, whether it keeps the rules or not."""
    return float(switch_ons(chosen).sum(axis=0) @ switching_prices([rule.terms(segments) for rule in rules], chosen.shape[1]))
