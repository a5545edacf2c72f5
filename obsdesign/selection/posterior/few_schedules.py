"""Where there are few schedules all of them are tried: then the best one is known, whatever rounding takes off the bounds of a search."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from obsdesign.selection.posterior.deadline import Deadline
from obsdesign.selection.posterior.options import Options

_MOST = 500  # schedules
_MOST_STEPS = 100_000  # steps of the path, of all schedules together


def few_walks(options: Options, steps: int) -> np.ndarray | None:
    """Return all walks (B, K) within the limits; None where they are too many to be tried along a path of so many steps."""
    most = min(_MOST, _MOST_STEPS // steps)
    walks = np.flatnonzero(options.allowed[0] & options.may_start)[:, None]
    usage = options.usage[:, 0, walks[:, 0]] + options.start_usage[:, -1, walks[:, 0]]
    for k in range(1, options.segments):
        if len(walks) > most:
            return None
        parent, node = np.nonzero(options.follows[walks[:, -1]] & options.allowed[k])
        usage = usage[:, parent] + options.usage[:, k, node] + options.start_usage[:, walks[parent, -1], node]
        keeps = (usage <= options.limits[:, None]).all(axis=0)
        walks, usage = np.hstack([walks[parent[keeps]], node[keeps, None]]), usage[:, keeps]
    walks = walks[(usage <= options.limits[:, None]).all(axis=0)]
    return walks if len(walks) <= most else None


def best_of_few(options: Options, walks: np.ndarray | None, cost: Callable[[np.ndarray], float], deadline: Deadline) -> np.ndarray | None:
    """Return the walk that costs least of some (B, K); None without any, and without time. cost: of a schedule (K, S) without switching."""
    best, least = None, np.inf
    for nodes in () if walks is None else walks:
        if deadline.is_over:
            return None
        chosen = options.chosen(nodes)
        value = cost(chosen) + options.switching_of(chosen)
        best, least = (nodes, value) if best is None or value < least else (best, least)
    return best


def all_tried(walks: np.ndarray | None) -> str:
    """Return what proves that a schedule is the best of some (B, K), in words."""
    if walks is None:
        return ""
    return f"all {len(walks)} schedules, each tried" if len(walks) > 1 else "the rules, which leave no other schedule"
