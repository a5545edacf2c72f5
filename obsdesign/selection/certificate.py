"""A schedule with all its numbers again, and what is said where there is none."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from obsdesign.errors import InputError
from obsdesign.round_off import EPS
from obsdesign.selection.directed_bound import prices_above, semidefinite_root, squares_below
from obsdesign.selection.dual import Dual
from obsdesign.selection.integer.search import Incumbent
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column_generation import dual_bound
from obsdesign.selection.schedule import Schedule, gap_of
from obsdesign.status import Status


def certify(instance: SelectionProblem, dual: Dual, fractional: int, incumbent: Incumbent, gap: float, notes: tuple[str, ...]) -> Schedule:
    """All numbers again, from the schedule and the dual alone."""
    value = instance.value(incumbent.chosen)
    if dual.mu.any():  # where a solver got no further, budgets may be worth nothing
        dual = min((dual, replace(dual, mu=np.zeros_like(dual.mu))), key=partial(_root_bound, instance))
    root_bound = max(_root_bound(instance, dual), value)  # they may cross by a rounding error
    bound = min(max(incumbent.bound, value), root_bound)
    achieved_gap = gap_of(value, bound, instance.criterion)
    forcing_costs = instance.schedules.forcing_costs(*instance.prices(dual))
    Z = instance.to_user_units(dual.Z)
    status = Status.OPTIMAL if achieved_gap <= gap else Status.GAP_OPEN
    hidden = instance.hidden_directions(incumbent.chosen) if value <= 0 else np.zeros((1, instance.n))
    if hidden.any():
        notes = (*notes, f"hidden: this schedule does not see the direction {_direction_text(hidden[hidden.any(axis=1)][0])} of the state")
    Z = Z[0] if len(Z) == 1 else Z
    return Schedule(
        incumbent.chosen,
        value,
        bound,
        root_bound,
        achieved_gap,
        Z,
        dual.offset,
        dual.mu,
        *forcing_costs,
        fractional,
        incumbent.nodes,
        status,
        notes,
    )


def _root_bound(instance: SelectionProblem, dual: Dual) -> float:
    """UB(dual), every rounding of it rounded up where the criterion is a smallest eigenvalue, as in `upper_bound`."""
    if not instance.criterion.is_smallest_eigenvalue:
        return dual_bound(instance, dual)[0]
    (K, S), n, D = instance.shape, instance.n, instance.scaled_criterion.D
    G = semidefinite_root(dual.Z)
    trace = squares_below((G * D[:, None])[:, instance.scaled_criterion.about])
    blocks, known = instance.user_blocks.reshape(K * S, n, n), (instance.known_information / D[:, None] / D)[None]
    worth, base = np.zeros((K, S)), 0.0
    for root, working in zip(G, instance.working_sensors, strict=True):
        worth += prices_above(blocks, D, root).reshape(K, S) * working
        base += float(prices_above(known, D, root)[0])
    worth = np.maximum(worth, 0.0) / trace
    _, largest_sum = instance.schedules.maximise(*instance.net_prices(worth, dual.mu))
    constant = base / trace + float(dual.mu @ instance.limits)
    # the best schedule is worth no less than nothing, so what it pays is at most what it sees
    return constant + largest_sum + (K + S + 8) * EPS * (constant + 2 * float(worth.sum()))


def failure_schedule(instance: SelectionProblem) -> Schedule:
    """Return NaN for every number, and the status NUMERICAL_ERROR."""
    K, S = instance.shape
    unknown = np.full((K, S), np.nan)
    Z = np.full((instance.n, instance.n), np.nan)
    return Schedule(
        np.zeros((K, S), dtype=bool), np.nan, np.nan, np.nan, np.nan, Z, np.nan, np.full(len(instance.resources), np.nan),
        unknown, unknown, 0, 0, Status.NUMERICAL_ERROR,
    )  # fmt: skip


def reject(instance: SelectionProblem, throw: bool, direction: np.ndarray | None = None) -> Schedule:
    """Raise InputError because the criterion is -inf for every schedule; with throw=False return the failed record."""
    if throw:
        losses = ", when the worst of them are lost" if len(instance.working_sensors) > 1 else ""
        name = type(instance.criterion).__name__
        direction_clause = "" if direction is None else f", {_direction_text(direction)}"
        raise InputError(
            f"criterion is {name}: it is -inf for every schedule within the rules{losses}: some direction stays unseen{direction_clause}"
        )
    return failure_schedule(instance)


def hidden_schedule(instance: SelectionProblem, hidden: np.ndarray, throw: bool) -> Schedule:
    """Nothing is on where a direction stays hidden whatever is on: an eigenvalue of 0, proven by Z = v v'.

    hidden (R, n): one for each scenario of loss, 0 for none.
    """
    worst = int(hidden.any(axis=1).argmax())
    if not instance.criterion.is_smallest_eigenvalue:
        return reject(instance, throw, hidden[worst])
    Z = np.zeros((len(hidden), instance.n, instance.n))
    Z[worst] = np.outer(hidden[worst], hidden[worst]) / np.sum(hidden[worst][instance.scaled_criterion.about] ** 2)
    on, off = instance.schedules.forcing_costs(np.zeros(instance.shape), instance.switching)
    words = _direction_text(hidden[worst])
    note = f"hidden: no sensor that may be on sees the direction {words} of the state, so the value of every schedule is 0"
    return Schedule(
        np.zeros(instance.shape, dtype=bool), 0.0, 0.0, 0.0, 0.0, Z[0] if len(Z) == 1 else Z, 0.0, np.zeros(len(instance.resources)),
        on, off, 0, 0, Status.OPTIMAL, (note,),
    )  # fmt: skip


def _direction_text(direction: np.ndarray) -> str:
    largest = direction[np.abs(direction).argmax()]
    return f"({', '.join(f'{entry:.3g}' for entry in direction / largest + 0.0)})"
