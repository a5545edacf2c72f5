"""Path and schedule improved in turn."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.design.best_design import chosen as best_of
from obsdesign.design.local_solve import Task, climbed
from obsdesign.design.record import Design
from obsdesign.joint.problem import Question
from obsdesign.selection.schedule import Schedule, gap_of
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

_STILL = 1e-9  # relative gain of a round that is none


@dataclass(frozen=True, eq=False)
class Pair:
    """A path with its design, a schedule, what its switching takes off the value, and the objective of the two."""

    design: Design
    path: Trajectory
    schedule: Schedule
    penalty: float
    objective: float


@dataclass(frozen=True, eq=False)
class Turns:
    """A pair to improve in turn, and what led there."""

    question: Question
    origin: str
    pair: Pair


@dataclass(frozen=True, eq=False)
class Settled:
    """Where turns ended; values: the objective before and after every half step; still: whether another round would gain nothing."""

    origin: str
    pair: Pair
    values: tuple[float, ...]
    still: bool


def paired(question: Question, design: Design, path: Trajectory, schedule: Schedule, penalty: float) -> Pair:
    """Return a pair with its objective recomputed."""
    objective = question.criterion(path, schedule.chosen) - penalty - question.price(path)
    return Pair(design, path, schedule, penalty, objective)


def settled(turns: Turns) -> Settled:
    """Improve the path for the schedule, then the schedule for the path, until a round gains nothing."""
    question, pair, values, still = turns.question, turns.pair, [turns.pair.objective], False
    for _ in range(turns.question.rounds):
        before = pair.objective
        pair, answered = _with_path(question, pair)
        values.append(pair.objective)
        pair = with_schedule(question, pair)
        values.append(pair.objective)
        still = answered and pair.objective <= before + _STILL * abs(before)
        if pair.objective <= before + _STILL * abs(before):
            break
    return Settled(turns.origin, pair, tuple(values), still)


def certified(question: Question, end: Settled) -> Settled:
    """Return the end with a proven schedule; where that is better than its own, the turns go on from there."""
    for _ in range(question.rounds):
        pair = with_schedule(question, end.pair, proven=True)
        if pair.objective <= end.pair.objective + _STILL * abs(end.pair.objective):
            return replace(end, pair=pair)
        again = settled(Turns(question, end.origin, pair))
        end = replace(again, values=(*end.values, *again.values))
    return replace(end, pair=with_schedule(question, end.pair, proven=True))


def shaped(question: Question, u: np.ndarray, chosen: np.ndarray) -> Design:
    """Climb to the nearest local optimum of the path for a schedule (K, S) from inputs u (N, m)."""
    problem = question.with_schedule(chosen)
    found = [climbed(Task(problem, "in turn", u, (problem.path,), True))]
    return best_of(problem, found, found)


def _with_path(question: Question, pair: Pair) -> tuple[Pair, bool]:
    """Return the pair with a path that is better for its schedule, if one was found, and whether the climb had an answer."""
    design = shaped(question, pair.path.u, pair.schedule.chosen)
    path = design.trajectory
    if path is None:
        return pair, False
    if question.allows(path, pair.schedule.chosen):
        moved = paired(question, design, path, pair.schedule, pair.penalty)
        return (moved if moved.objective >= pair.objective else pair), True
    found = _selected(question, design, path)
    return (found if found is not None and found.objective >= pair.objective else pair), True


def with_schedule(question: Question, pair: Pair, proven: bool = False) -> Pair:
    """Return the pair with the best schedule found for its path, or with its own where that is as good, certified for the path."""
    found = _selected(question, pair.design, pair.path, proven)
    if found is None or found.objective > pair.objective:
        return pair if found is None else found
    picked, value = found.schedule, pair.objective + question.price(pair.path)
    gap = gap_of(value, max(picked.bound, value), question.problem.criterion)
    status = Status.OPTIMAL if picked.status is Status.OPTIMAL and gap <= picked.gap else picked.status
    own = replace(picked, chosen=pair.schedule.chosen, value=value, gap=gap, status=status)
    return replace(pair, schedule=own)


def _selected(question: Question, design: Design, path: Trajectory, proven: bool = False) -> Pair | None:
    schedule = question.selected(path, proven)
    if not schedule.status.has_answer:
        return None
    return paired(question, design, path, schedule, question.penalty(path, schedule))
