"""Schedules that keep the rules and were had without thinking: greedy ones and random ones."""

from __future__ import annotations

import numpy as np

from obsdesign.selection.posterior.problem import PosteriorProblem
from obsdesign.selection.posterior.trellis import first_by_key, smallest_rest, start_of, successors

RANDOM_WALKS = 100
"""How many are drawn."""


def random_walks(problem: PosteriorProblem, seed: int) -> list[tuple[str, np.ndarray]]:
    """Return the walks (K,) of the median and the best of random ones, by name; none where these found no end, or it is late."""
    if problem.deadline.is_over:
        return []
    nodes, values = draw_walks(problem, RANDOM_WALKS, np.random.default_rng([seed, 2]))
    order = np.argsort(values, kind="stable")
    return [("median of random ones", nodes[order[len(order) // 2]]), ("best of random ones", nodes[order[0]])] if len(order) else []


def greedy_walk(problem: PosteriorProblem) -> list[tuple[str, np.ndarray]]:
    """Return the walk (K,) of greedy choices by its name, in a list; none where it finds no end."""
    nodes, _ = draw_walks(problem, 1, None)
    return [("greedy", nodes[0])] if len(nodes) else []


def draw_walks(problem: PosteriorProblem, count: int, random: np.random.Generator | None) -> tuple[np.ndarray, np.ndarray]:
    """Return walks (B, K) that keep the rules and their costs (B,): each step at random, or the one that costs least at once."""
    rest, options = smallest_rest(problem), problem.options
    frontier = start_of(problem, count)
    nodes = np.empty((count, problem.segments), dtype=int)
    alive = np.arange(count)
    for k in range(problem.segments):
        if random is not None and problem.deadline.is_over:
            return nodes[:0], np.zeros(0)
        step = successors(problem, frontier, k, rest)
        if random is not None:
            step = step.only(first_by_key(step.parent, random.random(len(step.node))))
        cost, P = problem.maps.advance(k, options.pattern_of_node[step.node], frontier.P[:, :, step.parent])
        switching = options.switching_costs[frontier.node[step.parent], step.node]
        best = first_by_key(step.parent, cost + switching)
        alive, nodes = alive[step.parent[best]], nodes[step.parent[best]]
        nodes[:, k] = step.node[best]
        frontier = frontier.advance(step, best, cost, switching, P, problem.is_worst)
    return nodes, frontier.value(problem.is_worst)
