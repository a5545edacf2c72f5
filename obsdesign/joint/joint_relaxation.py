"""Leaving the fixed points of turns: path and weights climbed together, then rounded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from obsdesign.blas_threads import one_thread
from obsdesign.design.feasibility import initial_rows
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.nlp.criterion_objective import matrix_objective_of
from obsdesign.design.nlp.joint_program import JointProgram
from obsdesign.design.nlp.program import Program
from obsdesign.design.sqp.trust_region_sqp import StoppingCriteria, solve
from obsdesign.joint.alternation import AlternationResult, AlternationStart, improve_path, make_pair
from obsdesign.joint.problem import JointProblem
from obsdesign.selection.schedule import Schedule

_STOPPING = StoppingCriteria(iterations=60, tolerance=1e-5)  # another climb follows, with a schedule
_MAX_WEIGHTS = 120  # weights in a climb: where there are more, neighbouring segments share theirs
_MAX_ROUNDED = 3  # rounded pairs that are worth turns
_SAME_OBJECTIVE = 1e-6  # relative difference of objectives that are one


@dataclass(frozen=True, eq=False)
class RelaxedStart:
    """Inputs u (N, m) and weights (K', S) to climb from together, and what led there."""

    joint_problem: JointProblem
    origin: str
    u: np.ndarray
    weights: np.ndarray


def relaxations(joint_problem: JointProblem, ends: Sequence[AlternationResult[Schedule]], starts: int) -> Iterator[RelaxedStart]:
    """Yield where to climb from: the ends of turns, their schedules half undone, and other paths with the same weight on all sensors."""
    S = len(joint_problem.problem.system.model.channels)
    groups = _groups(joint_problem.segments, S)
    uniform = np.full((groups, S), joint_problem.per_segment / S)
    for result in ends:
        mean_schedule = result.pair.schedule.chosen.reshape(groups, -1, S).mean(axis=1)
        yield RelaxedStart(joint_problem, f"relaxed, {result.origin}", result.pair.path.u, (uniform + mean_schedule) / 2)
    for name, u in islice(start_inputs(joint_problem.problem, joint_problem.seed), starts):
        yield RelaxedStart(joint_problem, f"relaxed, {name}", u, uniform)


def round_relaxation(start: RelaxedStart) -> AlternationStart[Schedule] | None:
    """Climb in (p, s), round by the selection on the path, and climb for that schedule; None where that has no answer."""
    joint_problem = start.joint_problem
    with one_thread():
        u = _solve_relaxation(start)
        path = joint_problem.problem.path_along(u)
        schedule = joint_problem.select_schedule(path)
        if not schedule.status.has_answer:
            return None
        design = improve_path(joint_problem, u, schedule.chosen)  # limits may be broken before, between the nodes
        if design.trajectory is None or not joint_problem.allows(design.trajectory, schedule.chosen):
            return None
        pair = make_pair(joint_problem, design, design.trajectory, schedule, joint_problem.switching_penalty(path, schedule))
        return AlternationStart(joint_problem, start.origin, pair)


def best_distinct(starts: Iterable[AlternationStart[Schedule] | None]) -> list[AlternationStart[Schedule]]:
    """Return the best few that differ."""
    best: list[AlternationStart[Schedule]] = []
    for start in sorted((start for start in starts if start is not None), key=lambda start: -start.pair.objective):
        objective = start.pair.objective
        if len(best) < _MAX_ROUNDED and not any(
            abs(objective - earlier.pair.objective) <= _SAME_OBJECTIVE * abs(objective) for earlier in best
        ):
            best.append(start)
    return best


def _groups(segments: int, sensors: int) -> int:
    """Return the largest number of equal groups of segments that does not take too many weights."""
    return max(count for count in range(1, segments + 1) if segments % count == 0 and (count == 1 or count * sensors <= _MAX_WEIGHTS))


def _solve_relaxation(start: RelaxedStart) -> np.ndarray:
    """Return the inputs (N, m) that a climb in path and weights comes to."""
    problem = start.joint_problem.problem
    path_program = Program(problem, initial_rows(problem), len(start.weights))
    program = JointProgram(path_program, len(start.weights), start.joint_problem.per_segment)
    first = program.join(problem.path.fit(start.u, problem.grid), start.weights)
    return path_program.inputs(program.split(solve(program, matrix_objective_of(problem), first, stopping=_STOPPING).p)[0])
