"""From the relaxation to whole schedules: first make it as whole as it can be, then round what is left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, sparse

from obsdesign.selection.integer.reduced_problem import Layer, Walks, information_in, layer_of, price_vector
from obsdesign.selection.problem import Instance, vectors
from obsdesign.selection.relaxation.column_generation import Relaxed, relaxed, size_of
from obsdesign.selection.relaxation.dual import Dual
from obsdesign.selection.relaxation.restricted_master import Column

_CLOSE = (300, 1500, 6000)  # segments, those decided with the least margin, in which the relaxation may be undecided
_LOST = 1e-7  # of the bound: what may be lost by that
_SHARE = 1e-9  # what is less counts as a 0 that the solver left positive


@dataclass(frozen=True, eq=False)
class Undecided:
    """A relaxed schedule: chosen (K, S) where it is whole, and in the layers shares (A,) of their patterns."""

    chosen: np.ndarray
    layers: tuple[Layer, ...]
    shares: tuple[np.ndarray, ...]

    @property
    def fractional(self) -> int:
        """Segments that are not whole."""
        return sum(bool(each.max() < 1 - 1e-7) for each in self.shares)

    def rounded(self, random: np.random.Generator | None) -> np.ndarray:
        """Return a whole schedule: the largest shares, or drawn by them."""
        chosen = self.chosen.copy()
        for layer, shares in zip(self.layers, self.shares, strict=True):
            index = shares.argmax() if random is None else random.choice(len(shares), p=shares / shares.sum())
            chosen[layer.segment] = layer.patterns[index]
        return chosen


def purified(instance: Instance, found: Relaxed) -> Undecided:
    """Return a relaxed schedule with the information of the mixture and as few undecided segments as a vertex has.

    The shares of patterns per segment with sum_k sum_p share_kp V_kp = V + t diag(metric) and t largest are a linear program with R d
    equations beside sum_p share_kp = 1: a basic solution has at most R d - 1 undecided segments, plus one for every resource. For
    schedules of linked segments: the mixture as it is.
    """
    used = [(column, share) for column, share in zip(found.columns, found.shares, strict=True) if share > _SHARE]
    picks = np.stack([column.chosen for column, _ in used])
    weights = np.array([share for _, share in used])
    weights /= weights.sum()
    differ = np.flatnonzero((picks != picks[0]).any(axis=(0, 2)))
    if instance.schedules.linked:
        return _listed(instance, picks, weights, differ)
    for close in _CLOSE:
        if len(differ) <= close:
            return _vertex(instance, _listed(instance, picks, weights, differ))
        narrow, value = _narrowed(instance, found, picks, differ, close)
        if close == _CLOSE[-1] or found.bound - value <= 2 * (found.bound - found.value) + _LOST * size_of(found.bound, instance):
            return _vertex(instance, narrow)
    raise AssertionError("the last is always taken")


def _listed(instance: Instance, picks: np.ndarray, weights: np.ndarray, segments: np.ndarray) -> Undecided:
    """The mixture by segment: which patterns it has there, with which shares."""
    chosen = picks[0].copy()
    layers, shares = [], []
    for k in segments:
        chosen[k] = False
        patterns, index = np.unique(picks[:, k], axis=0, return_inverse=True)
        layers.append(layer_of(instance, int(k), patterns))
        shares.append(np.bincount(index.ravel(), weights=weights, minlength=len(patterns)))
    return Undecided(chosen, tuple(layers), tuple(shares))


def _narrowed(instance: Instance, found: Relaxed, picks: np.ndarray, differ: np.ndarray, count: int) -> tuple[Undecided, float]:
    """The relaxation again, undecided only where the best schedule for the dual is so by the least margin."""
    price, start = instance.prices(found.dual)
    best, _ = instance.schedules.best(price, start)
    on, off = instance.schedules.regrets(price, start)
    margin = np.where(best, off, on).min(axis=1)
    close = differ[np.argsort(margin[differ], kind="stable")[:count]]
    listed = _listed(instance, np.concatenate([best[None], picks]), np.full(len(picks) + 1, 1.0), close)
    chosen = best.copy()
    chosen[close] = False
    base = np.concatenate([vectors(instance.information(chosen)).ravel(), instance.usage(chosen), [0.0]])
    walks = Walks(base, chosen, listed.layers, 0, 1, linked=False)
    m = len(instance.resources)

    def oracle(dual: Dual) -> tuple[float, Column]:
        y = price_vector(dual)
        steps, adds = walks.best(y, 0)
        total = base + adds
        usage = total[len(total) - 1 - m : -1]
        return instance.constant(dual) + float(y @ total), Column(steps, information_in(instance, total), usage, 0.0)

    again = relaxed(instance, 1e-9, (found.dual,), oracle=oracle)
    if again is None:
        return Undecided(best, (), ()), -np.inf
    steps = np.stack([column.chosen for column in again.columns])
    shares = [np.bincount(steps[:, i], weights=again.shares, minlength=len(layer.adds)) for i, layer in enumerate(walks.layers)]
    return Undecided(chosen, walks.layers, tuple(shares)), again.value


def _vertex(instance: Instance, mixture: Undecided) -> Undecided:
    if not mixture.layers:
        return mixture
    adds = np.concatenate([layer.adds[:, :-1] for layer in mixture.layers])  # the last counts switching
    shares = np.concatenate(mixture.shares)
    counts = [len(layer.adds) for layer in mixture.layers]
    n, R = instance.n, len(instance.kept)
    size = np.abs(adds).max(axis=0)
    size = np.where(size > 0, size, 1.0)
    m = len(instance.resources)
    metric = instance.judge.metric if instance.criterion.is_smallest_eigenvalue else np.ones(n)
    unit = np.concatenate([np.tile(vectors(np.diag(metric / metric.max())), R), np.zeros(m)])
    sums = sparse.csr_matrix((np.ones(len(adds)), (np.repeat(np.arange(len(counts)), counts), np.arange(len(adds)))))
    rows = sparse.vstack(
        [
            sparse.csr_matrix(np.column_stack([(adds / size).T, -unit / size])),
            sparse.hstack([sums, sparse.csr_matrix((len(counts), 1))]),
        ]
    )
    sides = np.concatenate([(shares @ adds) / size, np.ones(len(counts))])
    goal = np.append(np.zeros(len(adds)), -1.0)
    found = optimize.linprog(goal, A_eq=rows.tocsc(), b_eq=sides, bounds=[(0, None)] * len(goal), method="highs-ds")
    if found.x is None:
        return mixture
    parts = np.split(np.maximum(found.x[:-1], 0.0), np.cumsum(counts)[:-1])
    return Undecided(mixture.chosen, mixture.layers, tuple(part / part.sum() for part in parts))
