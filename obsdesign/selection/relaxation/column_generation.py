"""Dual column generation: prices, the best schedule for them, which joins the mixture that makes the next prices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.selection.dual import Dual
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column import Column, Mixture, column_of
from obsdesign.selection.relaxation.restricted_master import solve_master
from obsdesign.selection.scaled_criterion import ScaledCriterion

_MAX_ROUNDS = 400  # column generation ends in 5 to 60 rounds for few states, in some hundred for 15
_MAX_IDLE_ROUNDS = 12  # rounds after which a column without a share is dropped ...
_EARLY_ROUNDS = 40  # within which every direction that can be seen is expected to be; see _ROUNDS
_STALL_ROUNDS, _STALL_RATIO = 15, 0.9  # rounds within which a gap is expected to fall by so much, where climbs have to end in time
_MIXTURE_SIZE = 64  # schedules whose even mixture stands for relaxed choices
_REGULARISATIONS = (1e-9, 1e-7)  # of what all sensors know of a state: what a solver can tell from nothing
_MIN_POOL_SIZE = 60  # ... where there are more than so many


@dataclass(frozen=True, eq=False)
class RelaxedSolution:
    """The relaxation: columns and shares, its value, the best dual and its bound UB(dual), rounds, and every (dual, bound) met."""

    columns: list[Column]
    shares: np.ndarray
    value: float
    dual: Dual
    bound: float
    rounds: int
    evaluated_duals: list[tuple[Dual, float]]


def dual_bound(instance: SelectionProblem, dual: Dual) -> tuple[float, np.ndarray]:
    """UB(dual), and the schedule that is best for it."""
    chosen, largest_sum = instance.schedules.maximise(*instance.prices(dual))
    bound = instance.base_bound(dual) + largest_sum
    return bound + instance.slack(dual, bound), chosen


def price_column(instance: SelectionProblem, dual: Dual) -> tuple[float, Column]:
    """UB(dual), and the schedule that is best for it, as a column."""
    bound, chosen = dual_bound(instance, dual)
    return bound, column_of(instance, chosen)


Oracle = Callable[[Dual], tuple[float, Column]]  # the bound of a dual, and the schedule that attains it


def solve_relaxation(
    instance: SelectionProblem, gap: float, initial_duals: tuple[Dual, ...] = (), rounds: int = _MAX_ROUNDS, oracle: Oracle | None = None
) -> RelaxedSolution | None:
    """Return the relaxation to within `gap` of its bound, or None where the solver gives up at once.

    initial_duals: duals to begin with; oracle: what schedules there are, default: all that keep the rules.
    """
    pool = _ColumnPool(instance, oracle or partial(price_column, instance), oracle is None)
    start_duals = initial_duals or _isotropic_duals(instance)
    if not start_duals:
        return None  # some state is unseen by all sensors together: the criterion is -inf throughout
    for dual in start_duals:
        pool.price_dual(dual)
    mixture, initial_mixture = None, None
    round_count, smallest_gap, last_progress = 0, np.inf, 0
    while round_count < rounds and round_count - last_progress < _STALL_ROUNDS:
        candidate = solve_master(instance, pool.columns, mixture or initial_mixture)
        if candidate is None and mixture is None and (initial_mixture := pool.add_observable_columns()) is not None:
            candidate = solve_master(instance, pool.columns, initial_mixture)
        if candidate is None:
            break
        mixture, round_count = candidate, round_count + 1
        if round_count >= _EARLY_ROUNDS and instance.criterion.is_smallest_eigenvalue and mixture.value <= 0:
            break  # nothing is seen of some direction, and no round will change that
        # between the best prices and the newest: the newest alone jump about
        trials = (mixture.dual,) if pool.best is None else (convex_combination(pool.best, mixture.dual), mixture.dual)
        if not any(pool.price_dual(dual, mixture) for dual in trials) or is_gap_closed(mixture.value, pool.bound, gap, instance):
            break
        if instance.criterion.is_smallest_eigenvalue or pool.bound - mixture.value < _STALL_RATIO * smallest_gap:
            smallest_gap, last_progress = pool.bound - mixture.value, round_count
        mixture = pool.prune(mixture)
    if mixture is None or pool.best is None:
        return None
    count = len(mixture.shares)
    return RelaxedSolution(pool.columns[:count], mixture.shares, mixture.value, pool.best, pool.bound, round_count, pool.evaluated_duals)


def observable_mixture(instance: SelectionProblem) -> RelaxedSolution | None:
    """Return a mixture of schedules whose smallest eigenvalue, each state in its own unit, is at least half of the largest.

    Whatever switching costs.
    """
    smallest_eigenvalue = ScaledCriterion(MinEigenvalue(), np.ones(instance.n), instance.scaled_criterion.about)
    without_switching = replace(instance, scaled_criterion=smallest_eigenvalue, switching=np.zeros_like(instance.switching))
    return solve_relaxation(without_switching, 0.5, rounds=_EARLY_ROUNDS + 4 * instance.block_vectors.shape[2])


def solve_regularised(instance: SelectionProblem, gap: float) -> RelaxedSolution | None:
    """Return the relaxation where every mixture is next to singular, as far as a solver can tell; None where it fails, too.

    With d T more known, T the diagonal of all information and d small, the criterion is no smaller for any schedule: criterion(V) <=
    criterion(V + d T) <= <V, Z> + (offset + d <T, Z>). So the duals bound the problem itself, loosely where what is known is far below d;
    of a smallest eigenvalue without d <T, Z>, as every Z is a dual of the problem itself.
    """
    T = np.diagonal(instance.all_information, axis1=1, axis2=2).max(axis=0)
    for share in _REGULARISATIONS:
        addition = share * np.diag(np.where(T > 0, T, 1.0))
        relaxation = solve_relaxation(replace(instance, known_information=instance.known_information + addition), gap)
        if relaxation is None:
            continue
        if instance.criterion.is_smallest_eigenvalue:
            evaluated_duals = [(dual, dual_bound(instance, dual)[0]) for dual, _ in relaxation.evaluated_duals]
        else:
            evaluated_duals = [
                (replace(dual, offset=dual.offset + float(np.sum(dual.Z * addition))), bound) for dual, bound in relaxation.evaluated_duals
            ]
        dual, bound = min(evaluated_duals, key=lambda pair: pair[1])
        columns = [column_of(instance, column.chosen) for column in relaxation.columns]
        return RelaxedSolution(columns, relaxation.shares, -np.inf, dual, bound, relaxation.rounds, evaluated_duals)
    return None


def uniform_mixture(instance: SelectionProblem, shares: np.ndarray, dual: Dual) -> RelaxedSolution:
    """Return relaxed choices (K, S) of segments without links, and a dual, as an even mixture of schedules.

    Systematic sampling: schedule j has sensor s on where the sum of the shares up to s passes a whole number less (j + 1/2) / J.
    """
    bound, _ = dual_bound(instance, dual)
    cumulative = np.cumsum(shares, axis=1)
    marks = (np.arange(_MIXTURE_SIZE) + 0.5) / _MIXTURE_SIZE
    chosen = [np.diff(np.floor(cumulative + mark), axis=1, prepend=np.floor(mark)) > 0 for mark in marks]
    columns = [column_of(instance, schedule) for schedule in chosen]
    even = np.full(_MIXTURE_SIZE, 1 / _MIXTURE_SIZE)
    mean = np.tensordot(even, np.stack([column.W for column in columns]), 1)
    return RelaxedSolution(columns, even, instance.mixture_value(mean), dual, bound, 1, [(dual, bound)])


def is_gap_closed(value: float, bound: float, gap: float, instance: SelectionProblem) -> bool:
    """Whether value and bound are one to within `gap`: relative, or absolute for a criterion whose differences count."""
    return bound - value <= gap * gap_scale(bound, instance)


def gap_scale(bound: float, instance: SelectionProblem) -> float:
    """What a gap is a share of."""
    return abs(bound) if instance.criterion.gap_kind == "relative" else 1.0


def convex_combination(first: Dual, second: Dual, share: float = 0.5) -> Dual:
    """Return a mixture of two duals, which is one too."""
    return Dual(
        (1 - share) * first.Z + share * second.Z,
        (1 - share) * first.mu + share * second.mu,
        (1 - share) * first.offset + share * second.offset,
    )


class _ColumnPool:
    """The columns and duals met so far."""

    def __init__(self, instance: SelectionProblem, oracle: Oracle, is_unrestricted: bool) -> None:
        self.instance, self.oracle = instance, oracle
        self.columns: list[Column] = []
        self.idle_rounds: list[int] = []
        self.evaluated_duals: list[tuple[Dual, float]] = []
        self._is_unrestricted = is_unrestricted
        self._add_cheapest()

    @property
    def best(self) -> Dual | None:
        """The dual of the lowest bound, None where none is finite."""
        return self._best_pair[0]

    @property
    def bound(self) -> float:
        """The lowest bound of a dual."""
        return self._best_pair[1]

    @property
    def _best_pair(self) -> tuple[Dual | None, float]:
        return min((pair for pair in self.evaluated_duals if pair[1] < np.inf), key=lambda pair: pair[1], default=(None, np.inf))

    def price_dual(self, dual: Dual, mixture: Mixture | None = None) -> bool:
        """Bound by a dual, take its schedule as a column, and say whether the mixture gains from it."""
        bound, column = self.oracle(dual)
        self.evaluated_duals.append((dual, bound))
        if mixture is not None and not _improves(self.instance, mixture, column):
            return False
        self._add(column)
        return True

    def prune(self, mixture: Mixture) -> Mixture:
        """Drop the columns that have had no share for long."""
        has_share = mixture.shares > 1e-9
        self.idle_rounds[: len(has_share)] = [
            0 if is_used else count + 1 for is_used, count in zip(has_share, self.idle_rounds, strict=False)
        ]
        max_columns = max(_MIN_POOL_SIZE, 2 * self.instance.block_vectors.shape[2])
        if len(self.columns) <= max_columns:
            return mixture
        retained = np.array(self.idle_rounds) <= _MAX_IDLE_ROUNDS
        shares = mixture.shares[retained[: len(mixture.shares)]]
        self.columns[:] = [column for column, retain in zip(self.columns, retained, strict=True) if retain]
        self.idle_rounds[:] = [count for count, retain in zip(self.idle_rounds, retained, strict=True) if retain]
        return Mixture(shares / shares.sum(), mixture.value, mixture.dual, mixture.multipliers)

    def _add_cheapest(self) -> None:
        """The schedule that takes least of the resources, so that there is a mixture within the limits."""
        instance = self.instance
        if instance.resources:
            resource_dual = Dual(
                np.zeros((len(instance.working_sensors), instance.n, instance.n)), 1 / np.maximum(instance.limits, 1e-9), 0.0
            )
            self._add(self.oracle(resource_dual)[1])

    def add_observable_columns(self) -> Mixture | None:
        """Add the columns of a mixture within the limits that sees every direction, where a criterion is -inf for others; return it."""
        instance = self.instance
        if instance.criterion.is_smallest_eigenvalue or not self._is_unrestricted:
            return None
        observable = observable_mixture(instance)
        if observable is None or not np.isfinite(
            instance.mixture_value(
                np.tensordot(observable.shares, np.stack([observable_column.W for observable_column in observable.columns]), 1)
            )
        ):
            return None
        shares = np.concatenate([np.zeros(len(self.columns)), observable.shares])
        for column in observable.columns:
            self._add(column_of(instance, column.chosen))
        R = len(instance.working_sensors)
        return Mixture(shares, -np.inf, observable.dual, np.ones(R) / R)

    def _add(self, column: Column) -> None:
        self.columns.append(column)
        self.idle_rounds.append(0)


def _improves(instance: SelectionProblem, mixture: Mixture, column: Column) -> bool:
    dual = mixture.dual
    column_bound = float(np.sum(column.W * dual.Z)) - float(dual.mu @ column.usage) - column.penalty + instance.dual_constant(dual)
    return column_bound > mixture.value + 1e-13 * max(gap_scale(mixture.value, instance), np.finfo(float).tiny)


def _isotropic_duals(instance: SelectionProblem) -> tuple[Dual, ...]:
    """No direction dearer than another, in units in which all sensors together know as much of each state; () if there is no tangent."""
    total = np.diagonal(instance.all_information, axis1=1, axis2=2)
    zero_prices = np.zeros(len(instance.resources))
    weights = np.where(total > 0, 1 / np.where(total > 0, total, 1.0), 0.0)[:, :, None] * np.eye(instance.n)
    if instance.criterion.is_smallest_eigenvalue:
        metric = instance.scaled_criterion.metric
        judged_weights = weights * (metric > 0)
        return (Dual(judged_weights / np.sum(np.diagonal(judged_weights, axis1=1, axis2=2) * metric), zero_prices, 0.0),)
    if (total[:, instance.scaled_criterion.about] <= 0).any():
        return ()
    tangents = [instance.scaled_criterion.tangent(np.diag(row)) for row in total]
    R = len(tangents)
    return (Dual(np.stack([Z for Z, _ in tangents]) / R, zero_prices, sum(offset for _, offset in tangents) / R),)
