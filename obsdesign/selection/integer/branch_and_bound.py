"""Branch and bound: whole fronts of partial schedules at a time, bounded by a pool of duals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from logging import getLogger

import numpy as np

from obsdesign.selection.dual import Dual
from obsdesign.selection.integer.reduced_problem import Layer, ReducedProblem, information_of_sums, price_vector
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column import Column
from obsdesign.selection.relaxation.column_generation import RelaxedSolution, gap_scale, solve_relaxation

_LOGGER = getLogger(__name__)
_BATCH_SIZE = 1024  # partial schedules that are taken further at a time
_DUALS_PER_BATCH = 24  # duals that bound each of them ...
_NEW_DUALS = 8  # ... of which so many are made for the front
_COLUMN_ROUNDS = 6  # of column generation for a front
_MIN_BATCH_FOR_DUALS = 8  # fronts of fewer are not worth new duals
_DUAL_UPDATES = 25  # times on the way through linked segments, where duals take long
_BATCHES_BEFORE_ESTIMATE = 250  # fronts without a better schedule, after which the whole effort is estimated
_EARLY_BATCHES = 10  # fronts that settle what was out of the question anyway: no measure of how it goes on
_EFFORT_FACTOR = 20.0  # times the allowed effort


@dataclass(frozen=True, eq=False)
class TreeLimits:
    """Limits of a search: fronts that get duals of their own, partial schedules, whether time is up, and whether it stalls.

    stalls: whether to leave off once so much (a share of 1) is settled of what the first fronts left.
    """

    max_batches: int
    max_nodes: int
    out_of_time: Callable[[], bool]
    stalls: Callable[[float], bool]


@dataclass(frozen=True, eq=False)
class TreeResult:
    """The best schedule met, what no schedule is above, fronts and partial schedules looked at, and whether none is left."""

    chosen: np.ndarray
    value: float
    bound: float
    batches: int
    nodes: int
    is_complete: bool


@dataclass(frozen=True, eq=False)
class _NodeBatch:
    """Partial schedules that have the same layers left: states (F,), sums (F, c), steps (F, taken) in the layers taken, bounds (F,).

    duals: what bounds them; tree_share: of the whole tree, for estimating its size.
    """

    remaining: ReducedProblem
    layers_taken: tuple[Layer, ...]
    state: np.ndarray
    sums: np.ndarray
    steps: np.ndarray
    bound: np.ndarray
    duals: tuple[Dual, ...]
    tree_share: float

    def subset(self, mask: np.ndarray) -> _NodeBatch:
        """Return some of them; the share is that of all."""
        return _NodeBatch(
            self.remaining,
            self.layers_taken,
            self.state[mask],
            self.sums[mask],
            self.steps[mask],
            self.bound[mask],
            self.duals,
            self.tree_share,
        )


def explore_tree(
    instance: SelectionProblem,
    reduced: ReducedProblem,
    duals: list[Dual],
    incumbent: tuple[np.ndarray, float],
    gap: float,
    limits: TreeLimits,
) -> TreeResult:
    """Return the best of the remaining schedules and the incumbent, proven to within gap where the effort suffices.

    A front is a set of partial schedules; the relaxation of the best of them gives duals that bound them all, and says on which
    segment to branch: on the one whose undecided share moves the information most. Ends early after the first better schedule:
    the caller decides anew what is decided.
    """
    chosen, value = incumbent
    if any(not len(layer.source) for layer in reduced.layers) or not within_limits(instance, reduced.base[None])[0]:
        return TreeResult(chosen, value, cutoff(value, gap, instance), 0, 0, True)  # what is decided leaves no schedule at all
    state = np.array([reduced.initial_state])
    stack = [
        _NodeBatch(
            reduced, (), state, reduced.base[None], np.zeros((1, 0), np.int32), np.array([np.inf]), tuple(duals[-_DUALS_PER_BATCH:]), 1.0
        )
    ]
    batches = nodes = 0
    fathomed = early_fathomed = 0.0
    stride = max(1, len(reduced.layers) // _DUAL_UPDATES) if reduced.is_linked else 1
    while stack and batches < limits.max_batches and nodes < limits.max_nodes and not limits.out_of_time():
        batch = stack.pop()
        cutoff_value = cutoff(value, gap, instance)
        if not batch.remaining.layers:
            candidate, candidate_value = _best_schedule(instance, reduced, batch)
            fathomed += batch.tree_share
            if candidate_value > value:
                return TreeResult(candidate, candidate_value, np.inf, batches, nodes, False)
            continue
        influence = None
        if not batch.layers_taken or (len(batch.bound) >= _MIN_BATCH_FOR_DUALS and len(batch.layers_taken) % stride == 0):
            batch, influence = _generate_duals(instance, batch)
            batches += 1
        children, child_count = _branch_batch(instance, batch, influence, cutoff_value)
        nodes += child_count
        _LOGGER.debug("front %d: %d partial schedules, best value %.9g", batches, len(batch.bound), value)
        fathomed += batch.tree_share - sum(child.tree_share for child in children)
        stack += children
        early_fathomed = fathomed if batches <= _EARLY_BATCHES else early_fathomed
        is_hopeless = batches >= _BATCHES_BEFORE_ESTIMATE and batches > _EFFORT_FACTOR * limits.max_batches * max(fathomed, 1e-300)
        if is_hopeless or limits.stalls((fathomed - early_fathomed) / max(1 - early_fathomed, 1e-300)):
            break
    open_bound = max((float(batch.bound.max()) for batch in stack), default=-np.inf)
    return TreeResult(chosen, value, max(open_bound, cutoff(value, gap, instance)), batches, nodes, not stack)


def cutoff(incumbent_value: float, gap: float, instance: SelectionProblem) -> float:
    """What a bound has to be above to be worth a look: half of the gap is left for rounding."""
    return incumbent_value + 0.5 * gap * gap_scale(incumbent_value, instance) if np.isfinite(incumbent_value) else incumbent_value


def dual_constants(instance: SelectionProblem, duals: Sequence[Dual], level: float) -> np.ndarray:
    """Return what the bounds of duals (J,) have beside what is added up, with what rounding may hide where it counts at a level."""
    return np.array([instance.dual_constant(dual) + instance.slack(dual, level) for dual in duals])


def _generate_duals(instance: SelectionProblem, batch: _NodeBatch) -> tuple[_NodeBatch, np.ndarray | None]:
    """Solve the relaxation of what is left for the best of the front: its duals bound all of it; and the shares of the steps."""
    index = int(batch.bound.argmax())
    sums, state = batch.sums[index], int(batch.state[index])

    def oracle(dual: Dual) -> tuple[float, Column]:
        """Return the bound of a dual over what is undecided, and the column that attains it."""
        y = price_vector(dual)
        steps, added = batch.remaining.best_path(y, state)
        total = sums + added
        m = len(instance.resources)
        usage = total[len(total) - 1 - m : -1]
        return instance.dual_constant(dual) + float(y @ total), Column(steps, information_of_sums(instance, total), usage, float(total[-1]))

    Y = np.stack([price_vector(dual) for dual in batch.duals], axis=1)
    completion = batch.remaining.completion_bounds(batch.duals, Y)[state]
    constants = np.array([instance.dual_constant(dual) for dual in batch.duals])
    tightest = batch.duals[int((sums @ Y + completion + constants).argmin())]
    relaxation = solve_relaxation(instance, 1e-6, (tightest,), _COLUMN_ROUNDS, oracle)
    if relaxation is None:
        return batch, None
    duals = (*batch.duals, *(dual for dual, _ in relaxation.evaluated_duals[-_NEW_DUALS:]))[-_DUALS_PER_BATCH:]
    with_duals = _NodeBatch(batch.remaining, batch.layers_taken, batch.state, batch.sums, batch.steps, batch.bound, duals, batch.tree_share)
    return with_duals, None if batch.remaining.is_linked else _influence(instance, batch.remaining, relaxation)


def _influence(instance: SelectionProblem, remaining: ReducedProblem, relaxation: RelaxedSolution) -> np.ndarray:
    """How much of the information each layer (layers,) leaves undecided: the variance of what it adds, as the dual weighs it."""
    steps = np.stack([column.chosen for column in relaxation.columns])
    root = np.linalg.cholesky(relaxation.dual.Z + 1e-12 * np.trace(relaxation.dual.Z.sum(axis=0)) * np.eye(instance.n))
    influence = np.zeros(len(remaining.layers))
    for i, layer in enumerate(remaining.layers):
        shares = np.bincount(steps[:, i], weights=relaxation.shares, minlength=len(layer.increments))
        if shares.max() < 1 - 1e-9:
            deviation = information_of_sums(instance, layer.increments - shares @ layer.increments)
            influence[i] = shares @ np.sum((root.swapaxes(1, 2) @ deviation @ root) ** 2, axis=(1, 2, 3))
    return influence


def _branch_batch(
    instance: SelectionProblem, batch: _NodeBatch, influence: np.ndarray | None, cutoff_value: float
) -> tuple[list[_NodeBatch], int]:
    """Take every partial schedule one step further, in each way that its bound allows: new fronts, the best one last; and how many."""
    Y = np.stack([price_vector(dual) for dual in batch.duals], axis=1)
    constants = dual_constants(instance, batch.duals, cutoff_value)
    bound = np.minimum(
        batch.bound, (batch.sums @ Y + batch.remaining.completion_bounds(batch.duals, Y)[batch.state] + constants).min(axis=1)
    )
    batch_size = len(batch.bound)
    batch = batch.subset(bound > cutoff_value)
    bound = bound[bound > cutoff_value]
    index = 0 if batch.remaining.is_linked else _branching_layer(batch.remaining, Y, influence)
    layer, remaining = batch.remaining.layers[index], batch.remaining.without(index)
    counts = layer.offsets[batch.state + 1] - layer.offsets[batch.state]
    parent = np.repeat(np.arange(len(counts)), counts)
    step = np.arange(len(parent)) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(layer.offsets[batch.state], counts)
    sums, state = batch.sums[parent] + layer.increments[step], layer.target[step]
    bound = np.minimum(bound[parent], (sums @ Y + remaining.completion_bounds(batch.duals, Y)[state] + constants).min(axis=1))
    is_open = (bound > cutoff_value) & within_limits(instance, sums)
    tree_share = (batch.tree_share / batch_size / np.maximum(counts, 1)[parent])[is_open]
    parent, step, sums, state, bound = parent[is_open], step[is_open], sums[is_open], state[is_open], bound[is_open]
    order = np.argsort(bound, kind="stable")
    children = []
    for first in range(0, len(order), _BATCH_SIZE):
        chunk = order[first : first + _BATCH_SIZE]
        steps = np.column_stack([batch.steps[parent[chunk]], step[chunk].astype(np.int32)])
        children.append(
            _NodeBatch(
                remaining,
                (*batch.layers_taken, layer),
                state[chunk],
                sums[chunk],
                steps,
                bound[chunk],
                batch.duals,
                float(tree_share[chunk].sum()),
            )
        )
    return children, len(order)


def _branching_layer(remaining: ReducedProblem, Y: np.ndarray, influence: np.ndarray | None) -> int:
    """The layer to branch on: the one of most influence, or where it is not known the one whose steps differ most in price."""
    if influence is not None and influence.any():
        return int(influence.argmax())
    return int(np.argmax([np.ptp(layer.increments @ Y, axis=0).max() for layer in remaining.layers]))


def within_limits(instance: SelectionProblem, sums: np.ndarray) -> np.ndarray:
    """Whether no resource is exceeded yet, but for rounding."""
    m = len(instance.resources)
    if not m:
        return np.ones(len(sums), dtype=bool)
    return np.all(sums[:, -1 - m : -1] <= instance.rounded_limits, axis=1)


def _best_schedule(instance: SelectionProblem, reduced: ReducedProblem, batch: _NodeBatch) -> tuple[np.ndarray, float]:
    """The best of whole schedules, recomputed from its sensors."""
    chosen = schedules_of(reduced, batch.layers_taken, batch.steps)
    values = instance.values(chosen, information_of_sums(instance, batch.sums)) - batch.sums[:, -1]
    best = int(values.argmax())
    return chosen[best], instance.value(chosen[best])


def schedules_of(reduced: ReducedProblem, layers: tuple[Layer, ...], steps: np.ndarray) -> np.ndarray:
    """Return the schedules (F, K, S) of steps (F, taken) in the layers taken."""
    chosen = np.repeat(reduced.chosen[None], len(steps), axis=0)
    for layer, step in zip(layers, steps.T, strict=True):
        chosen[:, layer.segment] = layer.patterns[step]
    return chosen
