"""Which margins are asked of a path when: at its nodes, between them, or at one instant of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.design.between_nodes import MarginMinimum, fine_path
from obsdesign.design.nlp.evaluation import NO_ROWS, ConstraintRows, InstantChoice
from obsdesign.design.nlp.margin_curves import Intervals, MarginCurves, best_instant, intersect_intervals, margin_curves_of
from obsdesign.design.nlp.node_functions import node_functions_of
from obsdesign.design.problem import DesignProblem
from obsdesign.trajectory import Trajectory

_MARGIN_TOLERANCE = 5e-7  # by how much a margin, of order 1, may fall short before it is asked for again
# of a shortfall, so much more is asked for at a new instant, up to so much: the least margin moves a little when it is asked for
_SURPLUS, _MOST_SURPLUS = 0.1, 1e-5
_SAME_INSTANT = 1e-3  # share of a step within which two instants are one
_MAX_INSTANTS = 40  # instants of one margin that are asked for at once


def initial_rows(problem: DesignProblem) -> ConstraintRows:
    """Return which margins must hold when: at the nodes within each limit's time, and at its beginning and end."""
    functions, step = node_functions_of(problem.system.model, problem.constraints), problem.step
    if not functions.owner:  # limits that limit nothing, such as a distance from landmarks where there are none
        return NO_ROWS
    owner, of_inputs = np.array(functions.owner), np.array(functions.of_inputs)
    blocks, choices, row_count = [], [], 0
    for i, constraint in enumerate(problem.constraints):
        margin_indices = np.flatnonzero(owner == i)
        first, last = time_window(constraint, problem.steps * step)
        if constraint.span.anywhere:
            choices.append(InstantChoice(row_count + np.arange(len(margin_indices)), first, last))
            blocks += [(np.full(1, problem.steps), np.full(1, margin), np.zeros(1)) for margin in margin_indices]
            row_count += len(margin_indices)
            continue
        node, delay = _instants_within(first, last, problem.steps, step)
        for margin in margin_indices:
            # the start is given: nothing can be done about it there, unless the inputs matter
            is_constrained = (node > 0) | (delay > 0) | of_inputs[margin]
            blocks.append((node[is_constrained], np.full(int(is_constrained.sum()), margin), delay[is_constrained]))
            row_count += int(is_constrained.sum())
    node, margin, delay = (
        (np.concatenate(column) for column in zip(*blocks, strict=True)) if blocks else (NO_ROWS.node, NO_ROWS.margin, NO_ROWS.delay)
    )
    return ConstraintRows(node, margin, np.zeros(len(node)), delay, tuple(choices))


def time_window(constraint: AbstractConstraint, end: float) -> tuple[float, float]:
    """Return when a limit begins and ends to count [s], on a path of so many seconds."""
    first, last = (end if time is None else min(time, end) for time in (constraint.span.first, constraint.span.last))
    return first, last


def nodes_between(first: float, last: float, steps: int, step: float) -> np.ndarray:
    """Return the nodes from first to last [s]."""
    return np.arange(int(np.ceil(first / step - 1e-9)), min(steps, int(np.floor(last / step + 1e-9))) + 1)


def _instants_within(first: float, last: float, steps: int, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes from first to last [s], and these two themselves where they lie between nodes: as nodes, and seconds after them."""
    inside = nodes_between(first, last, steps, step)
    ends = np.array([time for time in dict.fromkeys((first, last)) if abs(time / step - round(time / step)) > 1e-9])
    before = np.floor(ends / step).astype(int)
    return np.concatenate([inside, before]), np.concatenate([np.zeros(len(inside)), ends - before * step])


@dataclass(frozen=True, eq=False)
class RowValues:
    """Rows (r,) of a path: their values without allowances, at nodes (r,) and so many seconds after them (r,)."""

    values: np.ndarray
    node: np.ndarray
    delay: np.ndarray


def evaluate_rows(problem: DesignProblem, rows: ConstraintRows, x: np.ndarray, u: np.ndarray, at_nodes: np.ndarray) -> RowValues:
    """Return rows along states x (N+1, n) with inputs u (N, m), given all margins at the nodes (N+1, r)."""
    node, delay = rows.node, rows.delay
    between = np.flatnonzero(delay > 0)
    if not len(between) and not rows.choices:
        return RowValues(at_nodes[node, rows.margin], node, delay)
    curves = margin_curves_of(problem.system.model, problem.constraints)
    values = at_nodes[node, rows.margin]
    if len(between):
        k = node[between]
        values[between] = curves.values(x[k], u[k], delay[between])[np.arange(len(k)), rows.margin[between]]
    if rows.choices:
        node, delay = node.copy(), delay.copy()
    for choice in rows.choices:
        best_node, tau = _choose_instant(problem, curves, choice, rows.margin[choice.rows], (x, u, at_nodes))
        node[choice.rows], delay[choice.rows] = best_node, tau
        values[choice.rows] = curves.values(x[[best_node]], u[[best_node]], np.array([tau]))[0, rows.margin[choice.rows]]
    return RowValues(values, node, delay)


def _choose_instant(
    problem: DesignProblem,
    curves: MarginCurves,
    choice: InstantChoice,
    margin_indices: np.ndarray,
    path: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> tuple[int, float]:
    """The node, and seconds after it, at which the margins `margin_indices` of a choice hold best."""
    (x, u, at_nodes), step = path, problem.step
    intervals, low, high = intersect_intervals(np.arange(len(u)) * step, step, choice.first, choice.last)
    lowest_margin = at_nodes[:, margin_indices].min(axis=1)
    end_margins = np.maximum(lowest_margin[intervals], lowest_margin[intervals + 1])
    # nowhere within a step is a margin larger than at an end of it by more than half of what a step can change
    retained = np.flatnonzero(~(end_margins + 0.6 * np.abs(np.diff(lowest_margin)).max() < end_margins.max()))
    promising = intervals[retained]
    i, tau, _ = best_instant(curves, Intervals(x[promising], u[promising], low[retained], high[retained]), margin_indices)
    return int(promising[i]), tau


def node_margins(problem: DesignProblem, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the margins that must hold at the nodes of states x (N+1, n) with inputs u (N, m), and at the ends of limits' times."""
    return node_margins_of_paths(problem, x[None], u[None])[0]


def node_margins_of_paths(problem: DesignProblem, x: np.ndarray, u: np.ndarray) -> list[np.ndarray]:
    """Return the same for each of R paths x (R, N+1, n), u (R, N, m)."""
    functions, rows = node_functions_of(problem.system.model, problem.constraints), initial_rows(problem)
    inputs = np.concatenate([u, u[:, -1:]], axis=1)
    at_nodes = functions.values(x.reshape(-1, x.shape[2]), inputs.reshape(-1, inputs.shape[2])).reshape(*x.shape[:2], len(functions.owner))
    return [evaluate_rows(problem, rows, *path).values for path in zip(x, u, at_nodes, strict=True)]


def tighten(problem: DesignProblem, path: Trajectory, rows: ConstraintRows, factor: float = 1.1) -> ConstraintRows | None:
    """Return rows that ask for what the path falls short of, at the instants at which it does, or None where it nowhere does.

    An instant that has a row already is asked for `factor` times the shortfall more. A new row asks for as much more as its margin
    is too large by the coarse steps of the path.
    """
    minima = [minimum for minimum in _margin_minima(problem, path) if minimum.value < -_MARGIN_TOLERANCE]
    if not minima:
        return None
    allowance, new_minima = rows.allowance.copy(), []
    times, choice_rows = rows.node * problem.step + rows.delay, {int(row) for choice in rows.choices for row in choice.rows}
    row_of_margin = {int(rows.margin[row]): row for row in choice_rows}
    for minimum in minima:
        if minimum.margin in row_of_margin:
            allowance[row_of_margin[minimum.margin]] -= factor * minimum.value
            continue
        nearby_rows = np.flatnonzero((rows.margin == minimum.margin) & (np.abs(times - minimum.time) <= _SAME_INSTANT * problem.step))
        if nearby_rows.size:
            allowance[nearby_rows] = rows.allowance[nearby_rows] - factor * minimum.value
        else:
            new_minima.append(minimum)
    return replace(rows, allowance=allowance).extend(_new_rows(problem, path, new_minima))


@np.errstate(invalid="ignore", over="ignore")
def _margin_minima(problem: DesignProblem, path: Trajectory) -> list[MarginMinimum]:
    """Local minima of all margins, the worst few of each; of what must hold once, the best instant."""
    if not node_functions_of(problem.system.model, problem.constraints).owner:
        return []
    fine, minima = fine_path(problem, path), []
    for i, constraint in enumerate(problem.constraints):
        minima += fine.minima_of(i, constraint.span)[: _MAX_INSTANTS * np.count_nonzero(fine.owner == i)]
    return minima


def _new_rows(problem: DesignProblem, path: Trajectory, minima: Sequence[MarginMinimum]) -> ConstraintRows:
    """Rows at the instants of local minima, by the path's own steps."""
    if not minima:
        return NO_ROWS
    step, functions = problem.step, node_functions_of(problem.system.model, problem.constraints)
    margin, time = np.array([minimum.margin for minimum in minima]), np.array([minimum.time for minimum in minima])
    node = np.minimum((time / step + 1e-9).astype(int), path.steps - 1)
    delay = np.clip(time - node * step, 0.0, step)
    is_before_jump = (
        np.array([minimum.before_jump for minimum in minima])
        & (delay < _SAME_INSTANT * step)
        & (node > 0)
        & np.array(functions.of_inputs)[margin]
    )
    node, delay = np.where(is_before_jump, node - 1, node), np.where(is_before_jump, step, delay)
    curves = margin_curves_of(problem.system.model, problem.constraints)
    coarse = curves.values(path.x[node], path.u[node], delay)[np.arange(len(node)), margin]
    value = np.array([minimum.value for minimum in minima])
    return ConstraintRows(node, margin, np.maximum(coarse - value, 0.0) + np.minimum(_SURPLUS * -value, _MOST_SURPLUS), delay)
