"""Better schedules where something is limited in sum: what two segments have on changes together, so that the limits still hold."""

from __future__ import annotations

import numpy as np

from obsdesign.selection.posterior.problem import PosteriorProblem, Walk

_MAX_STEPS = 1_200_000  # times `step_share`: steps into segments of all schedules that are looked at
_MAX_SINGLE = 500  # changes of a single segment, of either kind, that are paired
_MAX_PAIRS = 400  # pairs of changes that are looked at in a round
_BATCH = 1024  # schedules that are followed at once


def exchange(problem: PosteriorProblem, walk: Walk) -> Walk:
    """Return where the best change of one segment, or of two, leads to, again and again, until none is better or the work is done.

    All changes of a single segment are followed to the end, whether the limits allow them or not. Of the pairs that keep the limits
    those are followed that are promising: one takes less of a limit and one more, as in searches by swaps for knapsacks.
    """
    rest = _MAX_STEPS * problem.step_share
    while rest > 0 and not problem.deadline.is_over:
        places, nodes = _single_changes(problem, walk)
        single = _changed(walk, places[:, None], nodes[:, None])
        costs = _costs(problem, single)
        pairs = _promising_pairs(problem, walk, places, nodes, costs - walk.value)
        tried = np.concatenate([single[_keeps(problem, single)], pairs])
        if not len(tried):
            break
        rest -= problem.segments * (len(single) + len(tried))
        best = problem.walk(tried[int(_costs(problem, tried).argmin())])
        if not best.value < walk.value or not problem.is_feasible(best):
            break
        walk = best
    return walk


def _single_changes(problem: PosteriorProblem, walk: Walk) -> tuple[np.ndarray, np.ndarray]:
    """Return segments (M,) and what else they may have on (M,), where the neighbours of a segment allow it."""
    options, nodes = problem.options, walk.nodes
    fits = options.allowed.copy()
    fits[0] &= options.may_start
    fits[1:] &= options.follows[nodes[:-1]]
    fits[:-1] &= options.follows[:, nodes[1:]].T
    fits[np.arange(len(nodes)), nodes] = False
    places, changes = np.nonzero(fits)
    return places, changes


def _changed(walk: Walk, places: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Return walks (M, K) with other nodes (M, c) at places (M, c)."""
    walks = np.repeat(walk.nodes[None], len(places), axis=0)
    walks[np.arange(len(places))[:, None], places] = nodes
    return walks


def _promising_pairs(problem: PosteriorProblem, walk: Walk, places: np.ndarray, nodes: np.ndarray, gains: np.ndarray) -> np.ndarray:
    """Return walks (B, K) with a change that takes less of a limit and one that takes more, where both keep all limits.

    For every change that takes less the best of the others, by what each saves alone, before the second best of any.
    """
    options = problem.options
    taken = options.usage[:, places, nodes] - options.usage[:, places, walk.nodes[places]]
    gains = np.where(np.isfinite(gains), gains, np.inf)
    frees, takes = _best_changes(gains, taken.min(axis=0) < 0), _best_changes(gains, taken.max(axis=0) > 0)
    rank, first = (grid.ravel() for grid in np.indices((len(takes), len(frees))))
    first, second = frees[first], takes[rank]
    usage = problem.amounts(walk.nodes)[1:, None] + taken[:, first] + taken[:, second]
    may_fit = (usage <= options.limits[:, None] + options.start_usage.max(initial=0.0)).all(axis=0) & (places[first] != places[second])
    first, second = first[may_fit][: 4 * _MAX_PAIRS], second[may_fit][: 4 * _MAX_PAIRS]
    pairs = _changed(walk, np.column_stack([places[first], places[second]]), np.column_stack([nodes[first], nodes[second]]))
    return pairs[_keeps(problem, pairs)][:_MAX_PAIRS]


def _best_changes(gains: np.ndarray, is_one: np.ndarray) -> np.ndarray:
    """Return the best of the changes (M,) that are asked for, the best one first."""
    order = np.argsort(gains, kind="stable")
    return order[is_one[order]][:_MAX_SINGLE]


def _keeps(problem: PosteriorProblem, walks: np.ndarray) -> np.ndarray:
    """Whether walks (B, K) follow the chain within what is limited in sum (B,)."""
    options, segments = problem.options, np.arange(problem.segments)
    before = np.column_stack([np.full(len(walks), -1), walks[:, :-1]])
    follows = np.vstack([options.follows, options.may_start])[before, walks] & options.allowed[segments, walks]
    usage = options.usage[:, segments, walks] + options.start_usage[:, before, walks]
    return follows.all(axis=1) & (usage.sum(axis=2) <= options.limits[:, None]).all(axis=0)


def _costs(problem: PosteriorProblem, walks: np.ndarray) -> np.ndarray:
    """Return what walks (B, K) cost, limits left out."""
    parts = [_batch_costs(problem, walks[first : first + _BATCH]) for first in range(0, len(walks), _BATCH)]
    return np.concatenate([np.zeros(0), *parts])


def _batch_costs(problem: PosteriorProblem, walks: np.ndarray) -> np.ndarray:
    P, before = np.repeat(problem.P0[:, :, None], len(walks), axis=2), np.full(len(walks), -1)
    total, switching = np.full(len(walks), -np.inf if problem.is_worst else 0.0), np.zeros(len(walks))
    for k, node in enumerate(walks.T):
        cost, amounts, P = problem.advance(k, before, node, P)
        total, switching, before = problem.combine(total, cost), switching + amounts[0], node
    return total + switching
