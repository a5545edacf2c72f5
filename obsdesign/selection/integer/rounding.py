"""From the relaxation to whole schedules: first make it as whole as it can be, then round what is left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, sparse

from obsdesign.conic import svec
from obsdesign.selection.dual import Dual
from obsdesign.selection.integer.reduced_problem import Layer, ReducedProblem, information_of_sums, make_layer, price_vector
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column import Column
from obsdesign.selection.relaxation.column_generation import RelaxedSolution, gap_scale, solve_relaxation

_MAX_UNDECIDED = (300, 1500, 6000)  # segments, those decided with the least margin, in which the relaxation may be undecided
_ACCEPTED_LOSS = 1e-7  # of the bound: what may be lost by that
_SHARE_TOLERANCE = 1e-9  # what is less counts as a 0 that the solver left positive


@dataclass(frozen=True, eq=False)
class FractionalSchedule:
    """A relaxed schedule: chosen (K, S) where it is whole, and in the layers shares (A,) of their patterns."""

    chosen: np.ndarray
    layers: tuple[Layer, ...]
    shares: tuple[np.ndarray, ...]

    @property
    def fractional_segments(self) -> int:
        """Segments that are not whole."""
        return sum(bool(shares.max() < 1 - 1e-7) for shares in self.shares)

    def round_shares(self, random: np.random.Generator | None) -> np.ndarray:
        """Return a whole schedule: the largest shares, or drawn by them."""
        chosen = self.chosen.copy()
        for layer, shares in zip(self.layers, self.shares, strict=True):
            index = shares.argmax() if random is None else random.choice(len(shares), p=shares / shares.sum())
            chosen[layer.segment] = layer.patterns[index]
        return chosen


def purify(instance: SelectionProblem, relaxation: RelaxedSolution) -> FractionalSchedule:
    """Return a relaxed schedule with the information of the mixture and as few undecided segments as a vertex has.

    The shares of patterns per segment with sum_k sum_p share_kp V_kp = V + t diag(metric) and t largest are a linear program with R d
    equations beside sum_p share_kp = 1: a basic solution has at most R d - 1 undecided segments, plus one for every resource. For
    schedules of linked segments: the mixture as it is.
    """
    weighted_columns = [
        (column, share) for column, share in zip(relaxation.columns, relaxation.shares, strict=True) if share > _SHARE_TOLERANCE
    ]
    schedules = np.stack([column.chosen for column, _ in weighted_columns])
    weights = np.array([share for _, share in weighted_columns])
    weights /= weights.sum()
    undecided = np.flatnonzero((schedules != schedules[0]).any(axis=(0, 2)))
    if instance.schedules.is_linked:
        return _segment_mixture(instance, schedules, weights, undecided)
    for limit in _MAX_UNDECIDED:
        if len(undecided) <= limit:
            return _basic_solution(instance, _segment_mixture(instance, schedules, weights, undecided))
        restricted, value = _restrict(instance, relaxation, schedules, undecided, limit)
        if limit == _MAX_UNDECIDED[-1] or relaxation.bound - value <= 2 * (
            relaxation.bound - relaxation.value
        ) + _ACCEPTED_LOSS * gap_scale(relaxation.bound, instance):
            return _basic_solution(instance, restricted)
    raise AssertionError("the last is always taken")


def _segment_mixture(instance: SelectionProblem, schedules: np.ndarray, weights: np.ndarray, segments: np.ndarray) -> FractionalSchedule:
    """The mixture by segment: which patterns it has there, with which shares."""
    chosen = schedules[0].copy()
    layers, shares = [], []
    for k in segments:
        chosen[k] = False
        patterns, index = np.unique(schedules[:, k], axis=0, return_inverse=True)
        layers.append(make_layer(instance, int(k), patterns))
        shares.append(np.bincount(index.ravel(), weights=weights, minlength=len(patterns)))
    return FractionalSchedule(chosen, tuple(layers), tuple(shares))


def _restrict(
    instance: SelectionProblem, relaxation: RelaxedSolution, schedules: np.ndarray, undecided: np.ndarray, count: int
) -> tuple[FractionalSchedule, float]:
    """The relaxation again, undecided only where the best schedule for the dual is so by the least margin."""
    price, start = instance.prices(relaxation.dual)
    best, _ = instance.schedules.maximise(price, start)
    on, off = instance.schedules.forcing_costs(price, start)
    margin = np.where(best, off, on).min(axis=1)
    closest = undecided[np.argsort(margin[undecided], kind="stable")[:count]]
    mixture = _segment_mixture(instance, np.concatenate([best[None], schedules]), np.full(len(schedules) + 1, 1.0), closest)
    chosen = best.copy()
    chosen[closest] = False
    base = np.concatenate([svec(instance.information(chosen)).ravel(), instance.usage(chosen), [0.0]])
    reduced = ReducedProblem(base, chosen, mixture.layers, 0, 1, is_linked=False)
    m = len(instance.resources)

    def oracle(dual: Dual) -> tuple[float, Column]:
        """Return the bound of a dual over what is undecided, and the column that attains it."""
        y = price_vector(dual)
        steps, adds = reduced.best_path(y, 0)
        total = base + adds
        usage = total[len(total) - 1 - m : -1]
        return instance.dual_constant(dual) + float(y @ total), Column(steps, information_of_sums(instance, total), usage, 0.0)

    restricted = solve_relaxation(instance, 1e-9, (relaxation.dual,), oracle=oracle)
    if restricted is None:
        return FractionalSchedule(best, (), ()), -np.inf
    steps = np.stack([column.chosen for column in restricted.columns])
    shares = [
        np.bincount(steps[:, i], weights=restricted.shares, minlength=len(layer.increments)) for i, layer in enumerate(reduced.layers)
    ]
    return FractionalSchedule(chosen, reduced.layers, tuple(shares)), restricted.value


def _basic_solution(instance: SelectionProblem, mixture: FractionalSchedule) -> FractionalSchedule:
    if not mixture.layers:
        return mixture
    increments = np.concatenate([layer.increments[:, :-1] for layer in mixture.layers])  # the last counts switching
    shares = np.concatenate(mixture.shares)
    counts = [len(layer.increments) for layer in mixture.layers]
    n, R = instance.n, len(instance.working_sensors)
    scale = np.abs(increments).max(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    m = len(instance.resources)
    metric = instance.scaled_criterion.metric if instance.criterion.is_smallest_eigenvalue else np.ones(n)
    unit = np.concatenate([np.tile(svec(np.diag(metric / metric.max())), R), np.zeros(m)])
    convexity_rows = sparse.csr_matrix((np.ones(len(increments)), (np.repeat(np.arange(len(counts)), counts), np.arange(len(increments)))))
    rows = sparse.vstack(
        [
            sparse.csr_matrix(np.column_stack([(increments / scale).T, -unit / scale])),
            sparse.hstack([convexity_rows, sparse.csr_matrix((len(counts), 1))]),
        ]
    )
    right_hand_side = np.concatenate([(shares @ increments) / scale, np.ones(len(counts))])
    objective = np.append(np.zeros(len(increments)), -1.0)
    solution = optimize.linprog(objective, A_eq=rows.tocsc(), b_eq=right_hand_side, bounds=[(0, None)] * len(objective), method="highs-ds")
    if solution.x is None:
        return mixture
    shares_by_layer = np.split(np.maximum(solution.x[:-1], 0.0), np.cumsum(counts)[:-1])
    return FractionalSchedule(mixture.chosen, mixture.layers, tuple(layer_shares / layer_shares.sum() for layer_shares in shares_by_layer))
