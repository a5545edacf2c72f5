"""Where the next solve begins: where the last one stopped, moved on in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from obsdesign.design.feasibility import initial_rows
from obsdesign.design.nlp.evaluation import ConstraintRows
from obsdesign.design.sqp.evaluation import Multipliers
from obsdesign.design.tightening import SolveStart
from obsdesign.planning.plan import Memory
from obsdesign.planning.remaining_problem import RemainingProblem
from obsdesign.planning.solve_step import SolveResult
from obsdesign.status import Status

_BACK_OFF = 1e-3  # by how much solves stay within every limit, so that one that stops early, and what is between nodes, keeps it too
_MIN_RADIUS = 0.03  # of the trust region at least, in widths of the box: the start has moved since the last solve
_ITERATION_DECAY = 0.8  # share of the time of an iteration that is kept where none was made


def shifted_warm_start(remaining: RemainingProblem, constraint_indices: tuple[int, ...]) -> SolveStart:
    """Return where the last climb stopped, its rows and multipliers moved on in time."""
    grid, family, memory, rows = remaining.problem.grid, remaining.family, remaining.memory, initial_rows(remaining.problem)
    p = np.clip(memory.p[family.free_mask(grid)], *family.box(grid))
    # of a limit that is nearer than that, half of what there is
    back_off = np.clip(remaining.margins[rows.margin] / 2, 0.0, _BACK_OFF)
    old_rows, warm_start = memory.rows, memory.warm_start
    if old_rows is None or memory.constraint_indices != constraint_indices:
        return SolveStart(p, replace(rows, allowance=back_off), warm_start)
    matching = _matching_rows(rows, old_rows)
    rows = replace(rows, allowance=np.maximum(np.append(old_rows.allowance, 0.0)[matching], back_off))
    row_multipliers = None if warm_start is None else warm_start.multipliers.rows[: len(old_rows.node)]
    active_between = _active_between_nodes(old_rows, remaining.problem.steps, row_multipliers)
    rows, matching = rows.extend(old_rows.select(active_between)), np.append(matching, active_between)
    if warm_start is None:
        return SolveStart(p, rows, None)
    old_multipliers, count = warm_start.multipliers, len(old_rows.node)
    new_row_multipliers = np.concatenate([np.append(old_multipliers.rows[:count], 0.0)[matching], old_multipliers.rows[count:]])
    multipliers = Multipliers(old_multipliers.matrices, old_multipliers.floors, new_row_multipliers, old_multipliers.price)
    return SolveStart(p, rows, replace(warm_start, multipliers=multipliers, radius=max(warm_start.radius, _MIN_RADIUS)))


def _active_between_nodes(old: ConstraintRows, steps: int, row_multipliers: np.ndarray | None) -> np.ndarray:
    """Return the indices of old rows between nodes that lie ahead and that the last climb leaned on; without one, of all ahead."""
    is_choice = np.zeros(len(old.node), dtype=bool)
    for choice in old.choices:
        is_choice[choice.rows] = True
    ahead = (old.delay > 0) & (old.node >= 0) & (old.node < steps) & ~is_choice
    return np.flatnonzero(ahead if row_multipliers is None else ahead & (row_multipliers > 0))


def _matching_rows(rows: ConstraintRows, old: ConstraintRows) -> np.ndarray:
    """Return for each row the index of the old one at its instant, -1 without one; what counts at one instant only stays the same."""
    shape = [max(values.max(initial=0) for values in pair) + 1 for pair in ((rows.node, old.node), (rows.margin, old.margin))]
    row_at, row_of_margin = np.full(shape, -1), np.full(shape[1], -1)
    ahead = np.flatnonzero((old.node >= 0) & (old.delay == 0))
    row_at[old.node[ahead], old.margin[ahead]] = ahead
    at_node = np.flatnonzero(old.delay == 0)
    row_of_margin[old.margin[at_node]] = at_node
    is_single = np.bincount(rows.margin, minlength=shape[1])[rows.margin] == 1
    return np.where(is_single, row_of_margin[rows.margin], np.where(rows.delay == 0, row_at[rows.node, rows.margin], -1))


def next_memory(remaining: RemainingProblem, result: SolveResult, constraint_indices: tuple[int, ...], is_fallback: bool) -> Memory:
    """Return what the next step begins with: where the solve stopped, or the path itself after a solve that failed."""
    grid, family, next_start = remaining.problem.grid, remaining.family, result.next_start
    memory = replace(
        remaining.memory,
        iteration_seconds=result.iteration_seconds or _ITERATION_DECAY * remaining.memory.iteration_seconds,
        constraint_indices=constraint_indices,
    )
    has_failed = result.status in (Status.NUMERICAL_ERROR, Status.LOCALLY_INFEASIBLE)
    if next_start is None or (is_fallback and has_failed):
        return replace(memory, p=family.all_parameters(family.fit(result.checked.path.u, grid), grid), warm_start=None)
    return replace(memory, p=family.all_parameters(next_start.p, grid), rows=next_start.rows, warm_start=next_start.warm_start)
