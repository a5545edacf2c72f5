"""Schedules that keep the rules and were had without thinking: greedy ones and random ones."""

from __future__ import annotations

import numpy as np

from obsdesign.selection.posterior.problem import PosteriorProblem
from obsdesign.selection.posterior.trellis import smallest_rest, start_of, successors

RANDOM_WALKS = 100
"""How many are drawn."""


def rival_walks(problem: PosteriorProblem, seed: int) -> list[tuple[str, np.ndarray]]:
    """Return the walks (K,) of greedy choices, and of the median and the best of random ones, by name; without those that found no end."""
    greedy = draw_walks(problem, 1, None)
    drawn = draw_walks(problem, RANDOM_WALKS, np.random.default_rng([seed, 2]))
    walks = [("greedy", greedy[0][0])] if len(greedy[0]) else []
    nodes, values = drawn
    if len(values):
        order = np.argsort(values, kind="stable")
        walks += [("median of random ones", nodes[order[len(order) // 2]]), ("best of random ones", nodes[order[0]])]
    return walks


def draw_walks(problem: PosteriorProblem, count: int, random: np.random.Generator | None) -> tuple[np.ndarray, np.ndarray]:
    """Return walks (B, K) that keep the rules and their costs (B,): each step at random, or the one that costs least at once."""
    rest, options = smallest_rest(problem), problem.options
    frontier = start_of(problem, count)
    nodes = np.empty((count, problem.segments), dtype=int)
    alive = np.arange(count)
    for k in range(problem.segments):
        step = successors(problem, frontier, k, rest)
        if random is not None:
            step = step.only(_first_of_each(step.parent, random.random(len(step.node))))
        cost, P = problem.maps.advance(k, options.pattern_of_node[step.node], frontier.P[:, :, step.parent])
        switching = options.switching_costs[frontier.node[step.parent], step.node]
        best = _first_of_each(step.parent, cost + switching)
        alive, nodes = alive[step.parent[best]], nodes[step.parent[best]]
        nodes[:, k] = step.node[best]
        frontier = frontier.advance(step, best, cost, switching, P, problem.is_worst)
    return nodes, frontier.value(problem.is_worst)


def _first_of_each(group: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Return the place of the lowest score (B,) in each group (B,)."""
    order = np.lexsort((score, group))
    return order[np.diff(group[order], prepend=-1) > 0]
