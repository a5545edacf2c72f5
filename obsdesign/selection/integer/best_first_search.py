"""Branch and bound that takes the most promising partial schedules first, each with a dual of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from logging import getLogger

import numpy as np

from obsdesign.conic import svec
from obsdesign.selection.integer.branch_and_bound import TreeResult, cutoff, schedules_of, within_limits
from obsdesign.selection.integer.local_search import improve_by_exchange
from obsdesign.selection.integer.reduced_problem import ReducedProblem, information_of_sums, reduce_problem
from obsdesign.selection.integer.search import DUALS, Clock, Incumbent, SelectionOptions
from obsdesign.selection.integer.smoothed_dual import SmoothedDual, branch_decreases, descend, evaluate_duals, smooth_dual
from obsdesign.selection.pricing.abstract import AbstractSeparateSchedules
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column_generation import RelaxedSolution

_LOGGER = getLogger(__name__)
_WIDTH = 128  # partial schedules that are branched on at a time
_STEPS = 5  # of Newton's method for each branch
_ROOT_STEPS = 20  # of Newton's method at the root for each corner, made once: what is left of the gap there, every branch has to close
_CORNERS = (0.1, 0.03, 0.01, 0.004)  # how much corners are rounded off at the root, in turn
_CORNER = 0.05  # of the gap: ... and for branches
_MIN_TAU = 1e-9  # the same where next to no gap is left: tau divides, so it is not 0
_SCALE = 0.1  # of the gap: a fall of a bound by so much makes a tree smaller by a factor of e
_MIN_SCALE = 1e-9  # the same where value and bound are one to rounding: the scale divides, too
_PRICE = 0.01  # of resources, in units of the bound for all of one: where Newton's method begins
_WORTH = 0.25  # of the gap: how far below the best a rounding is worth polishing
_MAX_STEPS = 4000  # of all layers, and ...
_MAX_MEAN_STEPS = 8.0  # ... on average in a layer: where there are more, branching on all of them leads nowhere
_MAX_PRODUCTS = 8_000_000  # numbers in `SmoothedDual.products`: 64 MB of doubles
_WORK, _OVERHEAD = 5e9, 1e4  # steps times squares of the duals' entries: half a minute or so


@dataclass(frozen=True, eq=False)
class _Nodes:
    """Partial schedules: what is allowed (N, K, A), duals (N, c), bounds (N,)."""

    allowed: np.ndarray
    y: np.ndarray
    bound: np.ndarray

    def subset(self, which: np.ndarray) -> _Nodes:
        """Return some of them, by a mask or by indices."""
        return _Nodes(self.allowed[which], self.y[which], self.bound[which])

    def concatenate(self, second: _Nodes) -> _Nodes:
        """Return these, followed by others."""
        parts = zip((self.allowed, self.y, self.bound), (second.allowed, second.y, second.bound), strict=True)
        return _Nodes(*(np.concatenate(part) for part in parts))


def supports_best_first(instance: SelectionProblem) -> bool:
    """Whether the problem is one that this method knows: a smallest eigenvalue, segments without links."""
    return instance.criterion.is_smallest_eigenvalue and isinstance(instance.schedules, AbstractSeparateSchedules)


def continue_best_first(
    instance: SelectionProblem, relaxation: RelaxedSolution, incumbent: Incumbent, options: SelectionOptions, clock: Clock
) -> Incumbent:
    """Go on where branch and bound left off; the answer as it is where what is undecided is too large."""
    duals = sorted(relaxation.evaluated_duals, key=lambda pair: pair[1])[:DUALS]
    reduced = reduce_problem(instance, duals, cutoff(incumbent.value, options.gap, instance))
    if reduced is None or not reduced.layers or not all(len(layer.increments) for layer in reduced.layers) or not _fits(reduced):
        return incumbent
    result = search_best_first(instance, reduced, relaxation, (incumbent.chosen, incumbent.value), options.gap, clock.is_up)
    return Incumbent(result.chosen, result.value, min(result.bound, incumbent.bound), incumbent.nodes + result.nodes)


def _fits(reduced: ReducedProblem) -> bool:
    """Whether what is undecided is small enough for a dual of each part of it."""
    counts = [len(layer.increments) for layer in reduced.layers]
    steps, c = len(counts) * max(counts), len(reduced.base) - 1
    return steps <= _MAX_STEPS and sum(counts) <= _MAX_MEAN_STEPS * len(counts) and steps * c * (c + 1) // 2 <= _MAX_PRODUCTS


def search_best_first(
    instance: SelectionProblem,
    reduced: ReducedProblem,
    relaxation: RelaxedSolution,
    incumbent: tuple[np.ndarray, float],
    gap: float,
    out_of_time: Callable[[], bool],
) -> TreeResult:
    """Return the best of the remaining schedules and the incumbent, and what none of them is above, within a limit of work.

    Of the parts with the highest bounds, each is branched on the layer that promises the smallest tree; a few steps of Newton's
    method from the dual of the part lead to a dual of each branch. Its bound is in closed form, whatever the steps came to; steps
    of layers by which it would fall below the best schedule are closed.
    """
    (chosen, value), unit, count = incumbent, relaxation.bound, 0
    problem = smooth_dual(instance, reduced, unit).with_tau(max(_CORNER * (1 - value / unit), _MIN_TAU))
    max_nodes = _WORK / (problem.flat.size * problem.increments.shape[2] + _OVERHEAD)
    try:
        nodes = _root_node(problem, relaxation)
        while not out_of_time() and count < max_nodes:
            threshold = cutoff(value, gap, instance) / unit
            is_open = np.flatnonzero(nodes.bound > threshold)
            order = is_open[np.argsort(-nodes.bound[is_open], kind="stable")]
            if not len(order):
                nodes = nodes.subset(order)
                break
            children, steps = _branches(problem, nodes.subset(order[:_WIDTH]), max(_SCALE * (1 - value / unit), _MIN_SCALE), threshold)
            count += len(children.bound)
            is_complete = (children.allowed.sum(axis=2) == 1).all(axis=1)
            chosen, value = _improve_incumbent(instance, reduced, relaxation, (chosen, value), steps, is_complete)
            _LOGGER.debug("%d partial schedules so far, best value %.9g, bound %.9g", count, value, unit * float(nodes.bound[order[0]]))
            nodes = nodes.subset(order[_WIDTH:]).concatenate(children.subset(~is_complete))
    except np.linalg.LinAlgError:  # as far as double precision goes
        return TreeResult(chosen, value, relaxation.bound, 0, count, False)
    remaining_bound = float(nodes.bound.max(initial=-np.inf)) * unit
    return TreeResult(chosen, value, max(remaining_bound, cutoff(value, gap, instance)), 0, count, not len(nodes.bound))


def _root_node(problem: SmoothedDual, relaxation: RelaxedSolution) -> _Nodes:
    """All that is undecided, under the dual of the relaxation moved away from corners."""
    even = np.tile(np.eye(problem.n) / problem.n, (problem.scenarios, 1, 1))
    mixed = 0.9 * svec(relaxation.dual.Z).ravel() + 0.1 * svec(even).ravel() / (problem.e[: problem.entries] @ svec(even).ravel())
    y = np.concatenate([mixed, np.full(len(problem.base) - problem.entries, _PRICE)])[None]
    allowed = problem.exists[None]
    bound = np.inf
    for corner in (*(radius for radius in _CORNERS if radius > problem.tau), problem.tau):
        descent = descend(problem.with_tau(corner), y, allowed, _ROOT_STEPS, -np.inf)
        y, bound = descent.end.y, min(bound, float(descent.bound[0]))
    return _Nodes(allowed, y, np.array([bound]))


def _branches(problem: SmoothedDual, parts: _Nodes, scale: float, threshold: float) -> tuple[_Nodes, np.ndarray]:
    """The branches of parts that may be above `threshold`, and the steps (N, K) that have the largest shares in each."""
    layer = _layers(problem, parts, scale)
    index = np.arange(len(layer))
    parent, step = np.nonzero(parts.allowed[index, layer])
    allowed = parts.allowed[parent]
    rows = np.arange(len(parent))
    allowed[rows, layer[parent]] = False
    allowed[rows, layer[parent], step] = True
    descent = descend(problem, parts.y[parent], allowed, _STEPS, threshold)
    scores = problem.scores(descent.dual, allowed)
    best = scores.max(axis=2)
    allowed &= ~(problem.bounds(descent.dual, best)[:, None, None] - (best[:, :, None] - scores) <= threshold)
    bound = np.fmin(descent.bound, parts.bound[parent])
    is_open = (bound > threshold) & allowed.any(axis=2).all(axis=1) & _affordable(problem, allowed)
    return _Nodes(allowed[is_open], descent.end.y[is_open], bound[is_open]), np.where(allowed, descent.end.shares, -1.0)[is_open].argmax(
        axis=2
    )


def _layers(problem: SmoothedDual, parts: _Nodes, scale: float) -> np.ndarray:
    """The layers (N,) to branch on: with the smallest sum of exp(-fall of the bound / scale) over their steps."""
    points = evaluate_duals(problem, parts.y, parts.allowed)
    falls = branch_decreases(problem, points, parts.allowed)
    size = np.exp(-np.minimum(falls / scale, 700.0)).sum(axis=2)
    size[parts.allowed.sum(axis=2) <= 1] = np.inf
    return size.argmin(axis=1)


def _affordable(problem: SmoothedDual, allowed: np.ndarray) -> np.ndarray:
    """Whether (N,) what is allowed keeps the limits of the resources if the cheapest steps are taken."""
    room = problem.base[problem.entries :] + np.zeros((len(allowed), 1))
    for k in range(allowed.shape[1]):
        room = room + np.where(allowed[:, k, :, None], problem.increments[None, k, :, problem.entries :], -np.inf).max(axis=1)
    return np.all(room >= 0, axis=1)


def _improve_incumbent(
    instance: SelectionProblem,
    reduced: ReducedProblem,
    relaxation: RelaxedSolution,
    incumbent: tuple[np.ndarray, float],
    steps: np.ndarray,
    is_complete: np.ndarray,
) -> tuple[np.ndarray, float]:
    """The best of the whole schedules, of the most promising of the others, polished, and of what there is."""
    increments = [layer.increments[index] for layer, index in zip(reduced.layers, steps.T, strict=True)]
    sums = reduced.base + np.sum(increments, axis=0)
    W = information_of_sums(instance, sums)
    estimates = np.linalg.eigvalsh(instance.scaled_criterion.search_information(W))[..., 0].min(axis=1)
    estimates = np.where(within_limits(instance, sums), estimates, -np.inf)
    complete = np.flatnonzero(is_complete & np.isfinite(estimates))
    chosen, value = incumbent
    if len(complete):
        schedules = schedules_of(reduced, reduced.layers, steps[complete])
        values = instance.values(schedules, W[complete])
        if values.max() > value:
            chosen, value = schedules[values.argmax()], instance.value(schedules[values.argmax()])
    if len(estimates) and estimates.max() > value - _WORTH * (relaxation.bound - value):
        improved, improved_value = improve_by_exchange(
            instance, schedules_of(reduced, reduced.layers, steps[[estimates.argmax()]])[0], relaxation.dual, relaxation.bound
        )
        chosen, value = (improved, improved_value) if improved_value > value else (chosen, value)
    return chosen, value
