"""Leaving the fixed points of turns: path and weights climbed together, then rounded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from obsdesign.design.blas_threads import one_thread
from obsdesign.design.feasibility import rows_of
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.nlp.joint_program import Relaxed
from obsdesign.design.nlp.program import Program
from obsdesign.design.sqp.matrix_objective import aim_of
from obsdesign.design.sqp.trust_region_sqp import Limits, climb
from obsdesign.dynamics.simulation import simulate
from obsdesign.joint.alternation import Settled, Turns, paired, shaped
from obsdesign.joint.problem import Question

_LIMITS = Limits(iterations=60, tolerance=1e-5)  # another climb follows, with a schedule
_MANY = 120  # weights in a climb: where there are more, neighbouring segments share theirs
_KEPT = 3  # rounded pairs that are worth turns
_SAME = 1e-6  # relative difference of objectives that are one


@dataclass(frozen=True, eq=False)
class Relaxation:
    """Inputs u (N, m) and weights (K', S) to climb from together, and what led there."""

    question: Question
    origin: str
    u: np.ndarray
    weights: np.ndarray


def relaxations(question: Question, ends: Sequence[Settled], starts: int) -> Iterator[Relaxation]:
    """Yield where to climb from: the ends of turns, their schedules half undone, and other paths with the same weight on all sensors."""
    S = len(question.problem.system.model.channels)
    groups = _groups(question.segments, S)
    even = np.full((groups, S), question.per_segment / S)
    for end in ends:
        chosen = end.pair.schedule.chosen.reshape(groups, -1, S).mean(axis=1)
        yield Relaxation(question, f"relaxed, {end.origin}", end.pair.path.u, (even + chosen) / 2)
    for name, u in islice(start_inputs(question.problem, question.seed), starts):
        yield Relaxation(question, f"relaxed, {name}", u, even)


def rounded(start: Relaxation) -> Turns | None:
    """Climb in (p, s), round by the selection on the path, and climb for that schedule; None where that has no answer."""
    question = start.question
    with one_thread():
        u = _together(start)
        path = simulate(question.problem.system, question.problem.x0, u, question.problem.step, tolerance=question.problem.tolerance)
        schedule = question.selected(path)
        if not schedule.status.has_answer:
            return None
        design = shaped(question, u, schedule.chosen)  # limits may be broken before, between the nodes
        if design.trajectory is None or not question.allows(design.trajectory, schedule.chosen):
            return None
        pair = paired(question, design, design.trajectory, schedule, question.penalty(path, schedule))
        return Turns(question, start.origin, pair)


def promising(found: Iterable[Turns | None]) -> list[Turns]:
    """Return the best few that differ."""
    kept: list[Turns] = []
    for each in sorted((each for each in found if each is not None), key=lambda each: -each.pair.objective):
        level = each.pair.objective
        if len(kept) < _KEPT and not any(abs(level - other.pair.objective) <= _SAME * abs(level) for other in kept):
            kept.append(each)
    return kept


def _groups(segments: int, sensors: int) -> int:
    """Return the largest number of equal groups of segments that does not take too many weights."""
    return max(count for count in range(1, segments + 1) if segments % count == 0 and (count == 1 or count * sensors <= _MANY))


def _together(start: Relaxation) -> np.ndarray:
    """Return the inputs (N, m) that a climb in path and weights comes to."""
    problem = start.question.problem
    inner = Program(problem, rows_of(problem), len(start.weights))
    program = Relaxed(inner, len(start.weights), start.question.per_segment)
    first = program.joined(problem.path.fit(start.u, problem.grid), start.weights)
    return inner.inputs(program.parted(climb(program, aim_of(problem), first, limits=_LIMITS).p)[0])
