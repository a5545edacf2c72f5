"""Dual column generation: prices, the best schedule for them, which joins the mixture that makes the next prices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from obsdesign.criteria.min_eigenvalue import MinEigenvalue
from obsdesign.selection.problem import Instance
from obsdesign.selection.relaxation.dual import Dual
from obsdesign.selection.relaxation.restricted_master import Column, Mixture, column_of, mixed
from obsdesign.selection.scaled_criterion import Judge

_ROUNDS = 400  # column generation ends in 5 to 60 rounds for few states, in some hundred for 15
_IDLE = 12  # rounds after which a column without a share is dropped ...
_FIRST_ROUNDS = 40  # within which every direction that can be seen is expected to be; see _ROUNDS
_STALLED, _NARROWER = 15, 0.9  # rounds within which a gap is expected to fall by so much, where climbs have to end in time
_SAMPLES = 64  # schedules whose even mixture stands for relaxed choices
_RAISED = (1e-9, 1e-7)  # of what all sensors know of a state: what a solver can tell from nothing
_KEPT = 60  # ... where there are more than so many


@dataclass(frozen=True, eq=False)
class Relaxed:
    """The relaxation: columns and shares, its value, the best dual and its bound UB(dual), rounds, and every (dual, bound) met."""

    columns: list[Column]
    shares: np.ndarray
    value: float
    dual: Dual
    bound: float
    rounds: int
    met: list[tuple[Dual, float]]


def bound_of(instance: Instance, dual: Dual) -> tuple[float, np.ndarray]:
    """UB(dual), and the schedule that is best for it."""
    chosen, worth = instance.schedules.best(*instance.prices(dual))
    above = instance.ground(dual) + worth
    return above + instance.slack(dual, above), chosen


def priced(instance: Instance, dual: Dual) -> tuple[float, Column]:
    """UB(dual), and the schedule that is best for it, as a column."""
    above, chosen = bound_of(instance, dual)
    return above, column_of(instance, chosen)


Oracle = Callable[[Dual], tuple[float, Column]]  # the bound of a dual, and the schedule that attains it


def relaxed(
    instance: Instance, gap: float, first: tuple[Dual, ...] = (), rounds: int = _ROUNDS, oracle: Oracle | None = None
) -> Relaxed | None:
    """Return the relaxation to within `gap` of its bound, or None where the solver gives up at once.

    first: duals to begin with; oracle: what schedules there are, default: all that keep the rules.
    """
    pool = _Pool(instance, oracle or partial(priced, instance), oracle is None)
    begin = first or _even(instance)
    if not begin:
        return None  # some state is unseen by all sensors together: the criterion is -inf throughout
    for dual in begin:
        pool.price(dual)
    mixture, done, narrow, since = None, 0, np.inf, 0
    while done < rounds and done - since < _STALLED:
        found = mixed(instance, pool.columns, mixture or pool.begin)
        if found is None and mixture is None and pool.inform():
            found = mixed(instance, pool.columns, pool.begin)
        if found is None:
            break
        mixture, done = found, done + 1
        if done >= _FIRST_ROUNDS and instance.criterion.is_smallest_eigenvalue and mixture.value <= 0:
            break  # nothing is seen of some direction, and no round will change that
        # between the best prices and the newest: the newest alone jump about
        trials = (mixture.dual,) if pool.best is None else (between(pool.best, mixture.dual), mixture.dual)
        if not any(pool.price(dual, mixture) for dual in trials) or closed(mixture.value, pool.bound, gap, instance):
            break
        if instance.criterion.is_smallest_eigenvalue or pool.bound - mixture.value < _NARROWER * narrow:
            narrow, since = pool.bound - mixture.value, done
        mixture = pool.pruned(mixture)
    if mixture is None or pool.best is None:
        return None
    count = len(mixture.shares)
    return Relaxed(pool.columns[:count], mixture.shares, mixture.value, pool.best, pool.bound, done, pool.met)


def seen_through(instance: Instance) -> Relaxed | None:
    """Return a mixture of schedules whose smallest eigenvalue, each state in its own unit, is at least half of the largest.

    Whatever switching costs.
    """
    plain = Judge(MinEigenvalue(), np.ones(instance.n), instance.judge.about)
    calm = replace(instance, judge=plain, switching=np.zeros_like(instance.switching))
    return relaxed(calm, 0.5, rounds=_FIRST_ROUNDS + 4 * instance.rows.shape[2])


def raised(instance: Instance, gap: float) -> Relaxed | None:
    """Return the relaxation for a criterion that is -inf for every mixture, as far as a solver can tell; None where it fails, too.

    With d T more known, T the diagonal of all information and d small, the criterion is no smaller for any schedule: criterion(V) <=
    criterion(V + d T) <= <V, Z> + (offset + d <T, Z>). So the duals bound the problem itself, loosely where what is known is far below d.
    """
    T = np.diagonal(instance.everything, axis1=1, axis2=2).max(axis=0)
    for share in _RAISED:
        more = share * np.diag(np.where(T > 0, T, 1.0))
        found = relaxed(replace(instance, known=instance.known + more), gap)
        if found is None:
            continue
        met = [(replace(dual, offset=dual.offset + float(np.sum(dual.Z * more))), bound) for dual, bound in found.met]
        dual, bound = min(met, key=lambda each: each[1])
        columns = [column_of(instance, column.chosen) for column in found.columns]
        return Relaxed(columns, found.shares, -np.inf, dual, bound, found.rounds, met)
    return None


def mixture_of(instance: Instance, shares: np.ndarray, dual: Dual) -> Relaxed:
    """Return relaxed choices (K, S) of segments without links, and a dual, as an even mixture of schedules.

    Systematic sampling: schedule j has sensor s on where the sum of the shares up to s passes a whole number less (j + 1/2) / J.
    """
    bound, _ = bound_of(instance, dual)
    ends = np.cumsum(shares, axis=1)
    marks = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    chosen = [np.diff(np.floor(ends + mark), axis=1, prepend=np.floor(mark)) > 0 for mark in marks]
    columns = [column_of(instance, each) for each in chosen]
    even = np.full(_SAMPLES, 1 / _SAMPLES)
    mean = np.tensordot(even, np.stack([column.W for column in columns]), 1)
    return Relaxed(columns, even, instance.judged(mean), dual, bound, 1, [(dual, bound)])


def closed(value: float, bound: float, gap: float, instance: Instance) -> bool:
    """Whether value and bound are one to within `gap`: relative, or absolute for a criterion whose differences count."""
    return bound - value <= gap * size_of(bound, instance)


def size_of(bound: float, instance: Instance) -> float:
    """What a gap is a share of."""
    return abs(bound) if instance.criterion.is_relative else 1.0


def between(one: Dual, other: Dual, share: float = 0.5) -> Dual:
    """Return a mixture of two duals, which is one too."""
    return Dual(
        (1 - share) * one.Z + share * other.Z, (1 - share) * one.mu + share * other.mu, (1 - share) * one.offset + share * other.offset
    )


class _Pool:
    """The columns and duals met so far."""

    def __init__(self, instance: Instance, oracle: Oracle, whole: bool) -> None:
        self.instance, self.oracle = instance, oracle
        self.columns: list[Column] = []
        self.idle: list[int] = []
        self.met: list[tuple[Dual, float]] = []
        self.bound = np.inf
        self.best: Dual | None = None
        self.begin: Mixture | None = None
        self._whole = whole
        self._add_cheapest()

    def price(self, dual: Dual, mixture: Mixture | None = None) -> bool:
        """Bound by a dual, take its schedule as a column, and say whether the mixture gains from it."""
        above, column = self.oracle(dual)
        self.met.append((dual, above))
        if above < self.bound:
            self.best, self.bound = dual, above
        if mixture is not None and not _gains(self.instance, mixture, column):
            return False
        self._add(column)
        return True

    def pruned(self, mixture: Mixture) -> Mixture:
        """Drop the columns that have had no share for long."""
        used = mixture.shares > 1e-9
        self.idle[: len(used)] = [0 if each else count + 1 for each, count in zip(used, self.idle, strict=False)]
        most = max(_KEPT, 2 * self.instance.rows.shape[2])
        if len(self.columns) <= most:
            return mixture
        stay = np.array(self.idle) <= _IDLE
        shares = mixture.shares[stay[: len(mixture.shares)]]
        self.columns = [column for column, kept in zip(self.columns, stay, strict=True) if kept]
        self.idle = [count for count, kept in zip(self.idle, stay, strict=True) if kept]
        return Mixture(shares / shares.sum(), mixture.value, mixture.dual, mixture.multipliers)

    def _add_cheapest(self) -> None:
        """The schedule that takes least of the resources, so that there is a mixture within the limits."""
        instance = self.instance
        if instance.resources:
            least = Dual(np.zeros((len(instance.kept), instance.n, instance.n)), 1 / np.maximum(instance.limits, 1e-9), 0.0)
            self._add(self.oracle(least)[1])

    def inform(self) -> bool:
        """Begin with a mixture within the limits that sees every direction, where a criterion is -inf for others: False without one."""
        instance = self.instance
        if instance.criterion.is_smallest_eigenvalue or not self._whole:
            return False
        first = seen_through(instance)
        if first is None or not np.isfinite(instance.judged(np.tensordot(first.shares, np.stack([each.W for each in first.columns]), 1))):
            return False
        shares = np.concatenate([np.zeros(len(self.columns)), first.shares])
        for column in first.columns:
            self._add(column_of(instance, column.chosen))
        R = len(instance.kept)
        self.begin = Mixture(shares, -np.inf, first.dual, np.ones(R) / R)
        return True

    def _add(self, column: Column) -> None:
        self.columns.append(column)
        self.idle.append(0)


def _gains(instance: Instance, mixture: Mixture, column: Column) -> bool:
    dual = mixture.dual
    worth = float(np.sum(column.W * dual.Z)) - float(dual.mu @ column.usage) - column.penalty + instance.constant(dual)
    return worth > mixture.value + 1e-13 * max(size_of(mixture.value, instance), np.finfo(float).tiny)


def _even(instance: Instance) -> tuple[Dual, ...]:
    """No direction dearer than another, in units in which all sensors together know as much of each state; () if there is no tangent."""
    total = np.diagonal(instance.everything, axis1=1, axis2=2)
    nothing = np.zeros(len(instance.resources))
    weights = np.where(total > 0, 1 / np.where(total > 0, total, 1.0), 0.0)[:, :, None] * np.eye(instance.n)
    if instance.criterion.is_smallest_eigenvalue:
        metric = instance.judge.metric
        judged = weights * (metric > 0)
        return (Dual(judged / np.sum(np.diagonal(judged, axis1=1, axis2=2) * metric), nothing, 0.0),)
    if (total[:, instance.judge.about] <= 0).any():
        return ()
    tangents = [instance.judge.tangent(np.diag(row)) for row in total]
    R = len(tangents)
    return (Dual(np.stack([Z for Z, _ in tangents]) / R, nothing, sum(offset for _, offset in tangents) / R),)
