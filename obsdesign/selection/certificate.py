"""A schedule with all its numbers again, and what is said where there is none."""

from __future__ import annotations

import numpy as np

from obsdesign.errors import InputError
from obsdesign.selection.integer.search import Answer
from obsdesign.selection.problem import Instance
from obsdesign.selection.relaxation.column_generation import bound_of
from obsdesign.selection.relaxation.dual import Dual
from obsdesign.selection.schedule import Schedule, gap_of
from obsdesign.status import Status


def certified(instance: Instance, dual: Dual, fractional: int, answer: Answer, gap: float, notes: tuple[str, ...]) -> Schedule:
    """All numbers again, from the schedule and the dual alone."""
    value = instance.value(answer.chosen)
    root = max(bound_of(instance, dual)[0], value)  # they may cross by a rounding error
    bound = min(max(answer.bound, value), root)
    reached = gap_of(value, bound, instance.criterion)
    forced = instance.schedules.regrets(*instance.prices(dual))
    Z = instance.theirs(dual.Z)
    status = Status.OPTIMAL if reached <= gap else Status.GAP_OPEN
    hidden = instance.hidden(answer.chosen) if value <= 0 else np.zeros((1, instance.n))
    if hidden.any():
        notes = (*notes, f"hidden: this schedule does not see the direction {_in_words(hidden[hidden.any(axis=1)][0])} of the state")
    Z = Z[0] if len(Z) == 1 else Z
    return Schedule(answer.chosen, value, bound, root, reached, Z, dual.offset, dual.mu, *forced, fractional, answer.nodes, status, notes)


def failed(instance: Instance) -> Schedule:
    K, S = instance.shape
    nothing = np.full((K, S), np.nan)
    Z = np.full((instance.n, instance.n), np.nan)
    return Schedule(
        np.zeros((K, S), dtype=bool), np.nan, np.nan, np.nan, np.nan, Z, np.nan, np.full(len(instance.resources), np.nan),
        nothing, nothing, 0, 0, Status.NUMERICAL_ERROR,
    )  # fmt: skip


def refused(instance: Instance, throw: bool, direction: np.ndarray | None = None) -> Schedule:
    if throw:
        lost = ", when the worst of them are lost" if len(instance.kept) > 1 else ""
        name = type(instance.criterion).__name__
        where = "" if direction is None else f", {_in_words(direction)}"
        raise InputError(f"criterion is {name}: it is -inf for every schedule within the rules{lost}: some direction stays unseen{where}")
    return failed(instance)


def hidden_schedule(instance: Instance, hidden: np.ndarray, throw: bool) -> Schedule:
    """Nothing is on where a direction stays hidden whatever is on: an eigenvalue of 0, proven by Z = v v'.

    hidden (R, n): one for each scenario of loss, 0 for none.
    """
    worst = int(hidden.any(axis=1).argmax())
    if not instance.criterion.is_smallest_eigenvalue:
        return refused(instance, throw, hidden[worst])
    Z = np.zeros((len(hidden), instance.n, instance.n))
    Z[worst] = np.outer(hidden[worst], hidden[worst]) / np.sum(hidden[worst][instance.judge.about] ** 2)
    on, off = instance.schedules.regrets(np.zeros(instance.shape), instance.switching)
    words = _in_words(hidden[worst])
    note = f"hidden: no sensor that may be on sees the direction {words} of the state, so the value of every schedule is 0"
    return Schedule(
        np.zeros(instance.shape, dtype=bool), 0.0, 0.0, 0.0, 0.0, Z[0] if len(Z) == 1 else Z, 0.0, np.zeros(len(instance.resources)),
        on, off, 0, 0, Status.OPTIMAL, (note,),
    )  # fmt: skip


def _in_words(direction: np.ndarray) -> str:
    largest = direction[np.abs(direction).argmax()]
    return f"({', '.join(f'{entry:.3g}' for entry in direction / largest + 0.0)})"
