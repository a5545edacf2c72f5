"""Which margins are asked of a path when: at its nodes, between them, or at one instant of several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from obsdesign.constraints.abstract import AbstractConstraint
from obsdesign.design.between_nodes import Low, fine_margins
from obsdesign.design.nlp.evaluation import NO_ROWS, Choice, Rows
from obsdesign.design.nlp.margin_curves import Instants, Intervals, best_instant, instants_of, stretches
from obsdesign.design.nlp.node_functions import nodes_of
from obsdesign.design.problem import DesignProblem
from obsdesign.trajectory import Trajectory

_AIM = 5e-7  # by how much a margin, of order 1, may fall short before it is asked for again
# of a shortfall, so much more is asked for at a new instant, up to so much: the least margin moves a little when it is asked for
_SURPLUS, _MOST_SURPLUS = 0.1, 1e-5
_SAME = 1e-3  # share of a step within which two instants are one
_MOST = 40  # instants of one margin that are asked for at once


def rows_of(problem: DesignProblem) -> Rows:
    """Return which margins must hold when: at the nodes within each limit's time, and at its beginning and end."""
    functions, step = nodes_of(problem.system.model, problem.constraints), problem.step
    if not functions.owner:  # limits that limit nothing, such as a distance from landmarks where there are none
        return NO_ROWS
    owner, of_inputs = np.array(functions.owner), np.array(functions.of_inputs)
    found, choices, count = [], [], 0
    for i, constraint in enumerate(problem.constraints):
        mine = np.flatnonzero(owner == i)
        first, last = window_of(constraint, problem.steps * step)
        if constraint.span.anywhere:
            choices.append(Choice(count + np.arange(len(mine)), first, last))
            found += [(np.full(1, problem.steps), np.full(1, margin), np.zeros(1)) for margin in mine]
            count += len(mine)
            continue
        node, after = _instants_within(first, last, problem.steps, step)
        for margin in mine:
            # the start is given: nothing can be done about it there, unless the inputs matter
            kept = (node > 0) | (after > 0) | of_inputs[margin]
            found.append((node[kept], np.full(int(kept.sum()), margin), after[kept]))
            count += int(kept.sum())
    node, margin, after = (
        (np.concatenate(each) for each in zip(*found, strict=True)) if found else (NO_ROWS.node, NO_ROWS.margin, NO_ROWS.after)
    )
    return Rows(node, margin, np.zeros(len(node)), after, tuple(choices))


def window_of(constraint: AbstractConstraint, end: float) -> tuple[float, float]:
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
class Placed:
    """Rows (r,) of a path: their values without allowances, at nodes (r,) and so many seconds after them (r,)."""

    values: np.ndarray
    node: np.ndarray
    after: np.ndarray


def placed(problem: DesignProblem, rows: Rows, x: np.ndarray, u: np.ndarray, at_nodes: np.ndarray) -> Placed:
    """Return rows along states x (N+1, n) with inputs u (N, m), given all margins at the nodes (N+1, r)."""
    node, after = rows.node, rows.after
    between = np.flatnonzero(after > 0)
    if not len(between) and not rows.choices:
        return Placed(at_nodes[node, rows.margin], node, after)
    instants = instants_of(problem.system.model, problem.constraints)
    values = at_nodes[node, rows.margin]
    if len(between):
        k = node[between]
        values[between] = instants.values(x[k], u[k], after[between])[np.arange(len(k)), rows.margin[between]]
    if rows.choices:
        node, after = node.copy(), after.copy()
    for choice in rows.choices:
        at, tau = _chosen(problem, instants, choice, rows.margin[choice.rows], (x, u, at_nodes))
        node[choice.rows], after[choice.rows] = at, tau
        values[choice.rows] = instants.values(x[[at]], u[[at]], np.array([tau]))[0, rows.margin[choice.rows]]
    return Placed(values, node, after)


def _chosen(
    problem: DesignProblem, instants: Instants, choice: Choice, mine: np.ndarray, path: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> tuple[int, float]:
    """The node, and seconds after it, at which the margins `mine` of a choice hold best."""
    (x, u, at_nodes), step = path, problem.step
    within, low, high = stretches(np.arange(len(u)) * step, step, choice.first, choice.last)
    least = at_nodes[:, mine].min(axis=1)
    ends = np.maximum(least[within], least[within + 1])
    # nowhere within a step is a margin larger than at an end of it by more than half of what a step can change
    kept = np.flatnonzero(~(ends + 0.6 * np.abs(np.diff(least)).max() < ends.max()))
    promising = within[kept]
    i, tau, _ = best_instant(instants, Intervals(x[promising], u[promising], low[kept], high[kept]), mine)
    return int(promising[i]), tau


def node_margins(problem: DesignProblem, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the margins that must hold at the nodes of states x (N+1, n) with inputs u (N, m), and at the ends of limits' times."""
    values = nodes_of(problem.system.model, problem.constraints).values(x, np.vstack([u, u[-1:]]))
    return placed(problem, rows_of(problem), x, u, values).values


def tightened(problem: DesignProblem, path: Trajectory, rows: Rows, factor: float = 1.1) -> Rows | None:
    """Return rows that ask for what the path falls short of, at the instants at which it does, or None where it nowhere does.

    An instant that has a row already is asked for `factor` times the shortfall more. A new row asks for as much more as its margin
    is too large by the coarse steps of the path.
    """
    low = [each for each in _lows(problem, path) if each.value < -_AIM]
    if not low:
        return None
    allowance, more = rows.allowance.copy(), []
    times, asked = rows.node * problem.step + rows.after, {int(row) for choice in rows.choices for row in choice.rows}
    once = {int(rows.margin[row]): row for row in asked}
    for each in low:
        if each.margin in once:
            allowance[once[each.margin]] -= factor * each.value
            continue
        near = np.flatnonzero((rows.margin == each.margin) & (np.abs(times - each.time) <= _SAME * problem.step))
        if near.size:
            allowance[near] = rows.allowance[near] - factor * each.value
        else:
            more.append(each)
    return replace(rows, allowance=allowance).with_more(_new_rows(problem, path, more))


@np.errstate(invalid="ignore", over="ignore")
def _lows(problem: DesignProblem, path: Trajectory) -> list[Low]:
    """Local minima of all margins, the worst few of each; of what must hold once, the best instant."""
    if not nodes_of(problem.system.model, problem.constraints).owner:
        return []
    fine, found = fine_margins(problem, path), []
    for i, constraint in enumerate(problem.constraints):
        mine = np.flatnonzero(fine.owner == i)
        if not len(mine):
            continue
        if constraint.span.anywhere:
            found.append(fine.best(mine, constraint.span))
        else:
            found += sorted(fine.lows(mine, constraint.span), key=lambda low: low.value)[: _MOST * len(mine)]
    return found


def _new_rows(problem: DesignProblem, path: Trajectory, low: Sequence[Low]) -> Rows:
    """Rows at the instants of local minima, by the path's own steps."""
    if not low:
        return NO_ROWS
    step, functions = problem.step, nodes_of(problem.system.model, problem.constraints)
    margin, time = np.array([each.margin for each in low]), np.array([each.time for each in low])
    node = np.minimum((time / step + 1e-9).astype(int), path.steps - 1)
    after = np.clip(time - node * step, 0.0, step)
    before = np.array([each.before for each in low]) & (after < _SAME * step) & (node > 0) & np.array(functions.of_inputs)[margin]
    node, after = np.where(before, node - 1, node), np.where(before, step, after)
    instants = instants_of(problem.system.model, problem.constraints)
    coarse = instants.values(path.x[node], path.u[node], after)[np.arange(len(node)), margin]
    value = np.array([each.value for each in low])
    return Rows(node, margin, np.maximum(coarse - value, 0.0) + np.minimum(_SURPLUS * -value, _MOST_SURPLUS), after)
