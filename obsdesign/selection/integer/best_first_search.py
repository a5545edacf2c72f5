"""Branch and bound that takes the most promising partial schedules first, each with a dual of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from obsdesign.selection.integer.branch_and_bound import TreeResult, cutoff, schedules_of, within_limits
from obsdesign.selection.integer.local_search import improve_by_exchange
from obsdesign.selection.integer.reduced_problem import ReducedProblem, information_of_sums, reduce_problem
from obsdesign.selection.integer.search import DUALS, Clock, Incumbent, SelectionOptions
from obsdesign.selection.integer.smoothed_dual import Smoothed, at, declines, descended, smoothed
from obsdesign.selection.pricing.abstract import AbstractSeparateSchedules
from obsdesign.selection.problem import SelectionProblem, svec
from obsdesign.selection.relaxation.column_generation import RelaxedSolution

_WIDTH = 128  # partial schedules that are branched on at a time
_STEPS = 5  # of Newton's method for each branch
_ROOT_STEPS = 20  # of Newton's method at the root for each corner, made once: what is left of the gap there, every branch has to close
_CORNERS = (0.1, 0.03, 0.01, 0.004)  # how much corners are rounded off at the root, in turn
_CORNER = 0.05  # of the gap: ... and for branches
_SCALE = 0.1  # of the gap: a fall of a bound by so much makes a tree smaller by a factor of e
_PRICE = 0.01  # of resources, in units of the bound for all of one: where Newton's method begins
_WORTH = 0.25  # of the gap: how far below the best a rounding is worth polishing
_MOST_STEPS = 4000  # of all layers, and ...
_MOST_WAYS = 8.0  # ... on average in a layer: where there are more, branching on all of them leads nowhere
_MOST_PRODUCTS = 8_000_000  # numbers in `Smoothed.products`: 64 MB of doubles
_LEAST = 1e-9  # the same where next to no gap is left: tau divides, so it is not 0
_WORK, _OVERHEAD = 5e9, 1e4  # steps times squares of the duals' entries: half a minute or so


@dataclass(frozen=True, eq=False)
class _Nodes:
    """Partial schedules: what is allowed (N, K, A), duals (N, c), bounds (N,)."""

    allowed: np.ndarray
    y: np.ndarray
    bound: np.ndarray

    def only(self, which: np.ndarray) -> _Nodes:
        return _Nodes(self.allowed[which], self.y[which], self.bound[which])

    def joined(self, other: _Nodes) -> _Nodes:
        parts = zip((self.allowed, self.y, self.bound), (other.allowed, other.y, other.bound), strict=True)
        return _Nodes(*(np.concatenate(part) for part in parts))


def serves(instance: SelectionProblem) -> bool:
    """Whether the problem is one that this method knows: a smallest eigenvalue, segments without links."""
    return instance.criterion.is_smallest_eigenvalue and isinstance(instance.schedules, AbstractSeparateSchedules)


def finished(instance: SelectionProblem, found: RelaxedSolution, answer: Incumbent, wanted: SelectionOptions, clock: Clock) -> Incumbent:
    """Go on where branch and bound left off; the answer as it is where what is undecided is too large."""
    duals = sorted(found.evaluated_duals, key=lambda each: each[1])[:DUALS]
    walks = reduce_problem(instance, duals, cutoff(answer.value, wanted.gap, instance))
    if walks is None or not walks.layers or not all(len(layer.increments) for layer in walks.layers) or not _fits(walks):
        return answer
    result = best_first(instance, walks, found, (answer.chosen, answer.value), wanted.gap, clock.is_up)
    return Incumbent(result.chosen, result.value, min(result.bound, answer.bound), answer.nodes + result.nodes)


def _fits(walks: ReducedProblem) -> bool:
    """Whether what is undecided is small enough for a dual of each part of it."""
    counts = [len(layer.increments) for layer in walks.layers]
    steps, c = len(counts) * max(counts), len(walks.base) - 1
    return steps <= _MOST_STEPS and sum(counts) <= _MOST_WAYS * len(counts) and steps * c * (c + 1) // 2 <= _MOST_PRODUCTS


def best_first(
    instance: SelectionProblem,
    walks: ReducedProblem,
    found: RelaxedSolution,
    incumbent: tuple[np.ndarray, float],
    gap: float,
    out_of_time: Callable[[], bool],
) -> TreeResult:
    """Return the best of the walks and the incumbent, and what none of them is above, within a limit of work.

    Of the parts with the highest bounds, each is branched on the layer that promises the smallest tree; a few steps of Newton's
    method from the dual of the part lead to a dual of each branch. Its bound is in closed form, whatever the steps came to; steps
    of layers by which it would fall below the best schedule are closed.
    """
    (chosen, value), unit, count = incumbent, found.bound, 0
    problem = smoothed(instance, walks, unit).of_tau(max(_CORNER * (1 - value / unit), _LEAST))
    most = _WORK / (problem.flat.size * problem.adds.shape[2] + _OVERHEAD)
    try:
        nodes = _root(problem, found)
        while not out_of_time() and count < most:
            least = cutoff(value, gap, instance) / unit
            nodes = nodes.only(nodes.bound > least)
            if not len(nodes.bound):
                break
            first = np.argsort(-nodes.bound, kind="stable")
            children, steps = _branches(problem, nodes.only(first[:_WIDTH]), _SCALE * (1 - value / unit), least)
            count += len(children.bound)
            whole = (children.allowed.sum(axis=2) == 1).all(axis=1)
            chosen, value = _improved(instance, walks, found, (chosen, value), steps, whole)
            nodes = nodes.only(first[_WIDTH:]).joined(children.only(~whole))
    except np.linalg.LinAlgError:  # as far as double precision goes
        return TreeResult(chosen, value, found.bound, 0, count, False)
    left = float(nodes.bound.max(initial=-np.inf)) * unit
    return TreeResult(chosen, value, max(left, cutoff(value, gap, instance)), 0, count, not len(nodes.bound))


def _root(problem: Smoothed, found: RelaxedSolution) -> _Nodes:
    """All that is undecided, under the dual of the relaxation moved away from corners."""
    even = np.tile(np.eye(problem.n) / problem.n, (problem.scenarios, 1, 1))
    mixed = 0.9 * svec(found.dual.Z).ravel() + 0.1 * svec(even).ravel() / (problem.e[: problem.entries] @ svec(even).ravel())
    y = np.concatenate([mixed, np.full(len(problem.base) - problem.entries, _PRICE)])[None]
    allowed = problem.there[None]
    bound = np.inf
    for corner in (*(each for each in _CORNERS if each > problem.tau), problem.tau):
        descent = descended(problem.of_tau(corner), y, allowed, _ROOT_STEPS, -np.inf)
        y, bound = descent.end.y, min(bound, float(descent.bound[0]))
    return _Nodes(allowed, y, np.array([bound]))


def _branches(problem: Smoothed, parts: _Nodes, scale: float, least: float) -> tuple[_Nodes, np.ndarray]:
    """The branches of parts that may be above `least`, and the steps (N, K) that have the largest shares in each."""
    layer = _layers(problem, parts, scale)
    index = np.arange(len(layer))
    parent, step = np.nonzero(parts.allowed[index, layer])
    allowed = parts.allowed[parent]
    rows = np.arange(len(parent))
    allowed[rows, layer[parent]] = False
    allowed[rows, layer[parent], step] = True
    descent = descended(problem, parts.y[parent], allowed, _STEPS, least)
    scores = problem.scores(descent.dual, allowed)
    best = scores.max(axis=2)
    allowed &= ~(problem.bounds(descent.dual, best)[:, None, None] - (best[:, :, None] - scores) <= least)
    bound = np.fmin(descent.bound, parts.bound[parent])
    keep = (bound > least) & allowed.any(axis=2).all(axis=1) & _affordable(problem, allowed)
    return _Nodes(allowed[keep], descent.end.y[keep], bound[keep]), np.where(allowed, descent.end.shares, -1.0)[keep].argmax(axis=2)


def _layers(problem: Smoothed, parts: _Nodes, scale: float) -> np.ndarray:
    """The layers (N,) to branch on: with the smallest sum of exp(-fall of the bound / scale) over their steps."""
    points = at(problem, parts.y, parts.allowed)
    falls = declines(problem, points, parts.allowed)
    size = np.exp(-np.minimum(falls / scale, 700.0)).sum(axis=2)
    size[parts.allowed.sum(axis=2) <= 1] = np.inf
    return size.argmin(axis=1)


def _affordable(problem: Smoothed, allowed: np.ndarray) -> np.ndarray:
    """Whether (N,) what is allowed keeps the limits of the resources if the cheapest steps are taken."""
    room = problem.base[problem.entries :] + np.zeros((len(allowed), 1))
    for k in range(allowed.shape[1]):
        room = room + np.where(allowed[:, k, :, None], problem.adds[None, k, :, problem.entries :], -np.inf).max(axis=1)
    return np.all(room >= 0, axis=1)


def _improved(
    instance: SelectionProblem,
    walks: ReducedProblem,
    found: RelaxedSolution,
    best: tuple[np.ndarray, float],
    steps: np.ndarray,
    whole: np.ndarray,
) -> tuple[np.ndarray, float]:
    """The best of the whole schedules, of the most promising of the others, polished, and of what there is."""
    adds = [layer.increments[index] for layer, index in zip(walks.layers, steps.T, strict=True)]
    sums = walks.base + np.sum(adds, axis=0)
    W = information_of_sums(instance, sums)
    near = np.linalg.eigvalsh(instance.scaled_criterion.search_information(W))[..., 0].min(axis=1)
    near = np.where(within_limits(instance, sums), near, -np.inf)
    some = np.flatnonzero(whole & np.isfinite(near))
    chosen, value = best
    if len(some):
        those = schedules_of(walks, walks.layers, steps[some])
        values = instance.values(those, W[some])
        if values.max() > value:
            chosen, value = those[values.argmax()], instance.value(those[values.argmax()])
    if len(near) and near.max() > value - _WORTH * (found.bound - value):
        better, worth = improve_by_exchange(instance, schedules_of(walks, walks.layers, steps[[near.argmax()]])[0], found.dual, found.bound)
        chosen, value = (better, worth) if worth > value else (chosen, value)
    return chosen, value
