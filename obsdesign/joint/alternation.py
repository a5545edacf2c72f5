"""Path and schedule improved in turn."""

from __future__ import annotations

from dataclasses import dataclass, replace
from logging import getLogger
from typing import Generic

import numpy as np

from obsdesign.design.best_design import choose_best as best_of
from obsdesign.design.local_solve import LocalSolve, solve_locally
from obsdesign.design.record import Design
from obsdesign.joint.abstract import AbstractJointProblem
from obsdesign.joint.result import AnySchedule
from obsdesign.trajectory import Trajectory

_LOGGER = getLogger(__name__)
_GAIN_TOLERANCE = 1e-9  # relative gain of a round that is none


@dataclass(frozen=True, eq=False)
class Pair(Generic[AnySchedule]):
    """A path with its design, a schedule, what its switching takes off the value, and the objective of the two."""

    design: Design
    path: Trajectory
    schedule: AnySchedule
    penalty: float
    objective: float


@dataclass(frozen=True, eq=False)
class AlternationStart(Generic[AnySchedule]):
    """A pair to improve in turn, and what led there."""

    joint_problem: AbstractJointProblem[AnySchedule]
    origin: str
    pair: Pair[AnySchedule]


@dataclass(frozen=True, eq=False)
class AlternationResult(Generic[AnySchedule]):
    """Where it ended; values: the objective before and after every half step; is_stationary: whether another round would gain nothing."""

    origin: str
    pair: Pair[AnySchedule]
    values: tuple[float, ...]
    is_stationary: bool


def make_pair(
    joint_problem: AbstractJointProblem[AnySchedule], design: Design, path: Trajectory, schedule: AnySchedule, penalty: float
) -> Pair[AnySchedule]:
    """Return a pair with its objective recomputed."""
    objective = joint_problem.value_of(path, schedule.chosen, penalty) - joint_problem.path_price(path)
    return Pair(design, path, schedule, penalty, objective)


def alternate(start: AlternationStart[AnySchedule]) -> AlternationResult[AnySchedule]:
    """Improve the path for the schedule, then the schedule for the path, until a round gains nothing."""
    joint_problem, pair, values, is_stationary = start.joint_problem, start.pair, [start.pair.objective], False
    for _ in range(start.joint_problem.rounds):
        old_objective = pair.objective
        pair, has_answer = _path_half_step(joint_problem, pair)
        values.append(pair.objective)
        pair = schedule_half_step(joint_problem, pair)
        values.append(pair.objective)
        _LOGGER.debug("%s: round %d, objective %.9g", start.origin, len(values) // 2, pair.objective)
        is_stationary = has_answer and pair.objective <= old_objective + _GAIN_TOLERANCE * abs(old_objective)
        if pair.objective <= old_objective + _GAIN_TOLERANCE * abs(old_objective):
            break
    return AlternationResult(start.origin, pair, tuple(values), is_stationary)


def certify(joint_problem: AbstractJointProblem[AnySchedule], result: AlternationResult[AnySchedule]) -> AlternationResult[AnySchedule]:
    """Return the end with a proven schedule; where that is better than its own, the turns go on from there."""
    for _ in range(joint_problem.rounds):
        pair = schedule_half_step(joint_problem, result.pair, proven=True)
        if pair.objective <= result.pair.objective + _GAIN_TOLERANCE * abs(result.pair.objective):
            return replace(result, pair=pair)
        alternated = alternate(AlternationStart(joint_problem, result.origin, pair))
        result = replace(alternated, values=(*result.values, *alternated.values))
    return replace(result, pair=schedule_half_step(joint_problem, result.pair, proven=True))


def improve_path(joint_problem: AbstractJointProblem[AnySchedule], u: np.ndarray, chosen: np.ndarray) -> Design:
    """Climb to the nearest local optimum of the path for a schedule (K, S) from inputs u (N, m)."""
    problem = joint_problem.with_schedule(chosen)
    solutions = [solve_locally(LocalSolve(problem, "in turn", u, (problem.path,), True))]
    return best_of(problem, solutions, solutions)


def _path_half_step(joint_problem: AbstractJointProblem[AnySchedule], pair: Pair[AnySchedule]) -> tuple[Pair[AnySchedule], bool]:
    """Return the pair with a path that is better for its schedule, if one was found, and whether the climb had an answer."""
    design = improve_path(joint_problem, pair.path.u, pair.schedule.chosen)
    path = design.trajectory
    if path is None:
        return pair, False
    if joint_problem.allows(path, pair.schedule.chosen):
        improved = make_pair(joint_problem, design, path, pair.schedule, pair.penalty)
        return (improved if improved.objective >= pair.objective else pair), True
    candidate = _select_pair(joint_problem, design, path)
    return (candidate if candidate is not None and candidate.objective >= pair.objective else pair), True


def schedule_half_step(
    joint_problem: AbstractJointProblem[AnySchedule], pair: Pair[AnySchedule], proven: bool = False
) -> Pair[AnySchedule]:
    """Return the pair with the best schedule found for its path, or with its own where that is as good, certified for the path."""
    candidate = _select_pair(joint_problem, pair.design, pair.path, proven)
    if candidate is None or candidate.objective > pair.objective:
        return pair if candidate is None else candidate
    value = pair.objective + joint_problem.path_price(pair.path)
    return replace(pair, schedule=joint_problem.certify_chosen(pair.path, pair.schedule.chosen, value, candidate.schedule))


def _select_pair(
    joint_problem: AbstractJointProblem[AnySchedule], design: Design, path: Trajectory, proven: bool = False
) -> Pair[AnySchedule] | None:
    schedule = joint_problem.select_schedule(path, proven)
    if not schedule.status.has_answer:
        return None
    return make_pair(joint_problem, design, path, schedule, joint_problem.switching_penalty(path, schedule))
