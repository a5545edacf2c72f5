"""Path and schedule together: one-sided answers, turns, relaxed climbs, and the best of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from logging import getLogger
from time import perf_counter
from typing import Any, Literal, TypeAlias, overload

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design
from obsdesign.design.upper_bound import cap_of
from obsdesign.errors import InputError, SolveError
from obsdesign.joint.abstract import AbstractJointProblem
from obsdesign.joint.alternation import AlternationResult, AlternationStart, Pair, alternate, certify
from obsdesign.joint.filter_problem import FilterJointProblem
from obsdesign.joint.joint_relaxation import best_distinct, relaxations, round_relaxation
from obsdesign.joint.one_sided import OneSidedAnswer, one_sided_answers
from obsdesign.joint.problem import JointProblem
from obsdesign.joint.result import AnySchedule, Joint
from obsdesign.progress import Progress, StageReport
from obsdesign.rules.abstract import AbstractRule
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.schedule import Schedule
from obsdesign.status import Status

_LOGGER = getLogger(__name__)
_Relaxation: TypeAlias = Callable[[Sequence[AlternationResult[AnySchedule]]], list[AlternationResult[AnySchedule]]]
ROUNDS = 20  # of path, then schedule; a few settle it


@overload
def codesign(
    problem: DesignProblem,
    segments: int,
    per_segment: int = 1,
    rules: tuple[AbstractRule, ...] = (),
    *,
    question: Literal["start"] = "start",
    starts: int = 8,
    rounds: int = ROUNDS,
    seed: int = 0,
    executor: Executor | None = None,
    throw: bool = True,
    gap: float | None = None,
    progress: Progress | None = None,
) -> Joint[Schedule]:
    """Choose them for what the samples tell of the start."""
    ...


@overload
def codesign(
    problem: DesignProblem,
    segments: int,
    per_segment: int = 1,
    rules: tuple[AbstractRule, ...] = (),
    *,
    question: Literal["filter"],
    starts: int = 8,
    rounds: int = ROUNDS,
    seed: int = 0,
    executor: Executor | None = None,
    throw: bool = True,
    gap: float | None = None,
    progress: Progress | None = None,
) -> Joint[FilterSchedule]:
    """Choose them for what a filter knows."""
    ...


@validate_arguments
def codesign(
    problem: DesignProblem,
    segments: int,
    per_segment: int = 1,
    rules: tuple[AbstractRule, ...] = (),
    *,
    question: Literal["start", "filter"] = "start",
    starts: int = 8,
    rounds: int = ROUNDS,
    seed: int = 0,
    executor: Executor | None = None,
    throw: bool = True,
    gap: float | None = None,
    progress: Progress | None = None,
) -> Joint[Any]:
    """Choose a path and a schedule of its sensors together.

    "start": max over paths p and schedules s of criterion(S (sum_ks s_ks W_ks(p)) S), at most per_segment sensors on in each of K
    segments. Both one-sided answers come first. From each, path and schedule are improved in turn; then from there, and from `starts`
    other paths, both are optimised together with weights s in [0, 1] and are rounded by the selection on the path so found; the best few
    are improved in turn again. The answer is the best of all, so never below a one-sided one; it is a local optimum.

    "filter": max of the criterion `Posterior` with the samples of the schedule alone, over the instants that it asks about; schedules are
    those of `select_for_filter`. Both one-sided answers, and from each path and schedule in turn, a turn that does not improve not being
    taken; the best of all is the answer. Nothing is relaxed: a recursion is not linear in weights between 0 and 1.

    Arguments:
        problem: the design problem, of one duration.
        segments: number K of equal segments, which divides the steps.
        per_segment: how many sensors may be on at a time.
        rules: what schedules have to keep, as for select_sensors; what switching costs is in the unit of the criterion or, of a filter,
            of the cost.
        question: "start", how much the samples tell of x(t_0): a `Schedule`; "filter", what is known on the way or at the end, by a
            `Posterior`: a `FilterSchedule`.
        starts: number of starts of each design, and of other paths that the search with relaxed weights begins from.
        rounds: largest number of turns of path and schedule.
        seed: seed of these paths.
        executor: runs the local solves, one task each; the answer is the same for any number of workers.
        throw: False = return a failed Joint instead of raising SolveError.
        gap: `joint.proof` branches on segments until its bound is that near to the value, or it has 200 nodes; None = without branches.
            The answer is the same.
        progress: is called with what is being done, as it begins; None = nobody is told.
    Raises InputError for a range of durations, a criterion that does not go with the question (`Posterior` with "filter", one that
    is additive over sensors with "start"), segments that do not divide the steps; UnobservableError, and SolveError where no path and
    schedule were found.
    """
    require_count("starts", starts)
    if gap is not None and not 0 <= gap < 1:
        raise InputError(f"gap: is {gap:g}: must be at least 0 and less than 1")
    asked = problem, segments, per_segment, tuple(rules), seed, rounds
    search = _JointSearch(starts, executor, StageReport(_LOGGER, progress))
    joint = _solve_for_start(search, JointProblem(*asked)) if question == "start" else search.solve(FilterJointProblem(*asked))
    if throw and not joint.status.has_answer:
        raise SolveError("codesign", joint.status, joint.design.reason)
    return replace(joint, per_segment=per_segment, gap_limit=gap, rules=tuple(rules))


@dataclass(frozen=True, eq=False)
class _JointSearch:
    """How much is looked for, by whom, and who is told."""

    starts: int
    executor: Executor | None
    report: StageReport

    def solve(self, joint_problem: AbstractJointProblem[AnySchedule], relax: _Relaxation[AnySchedule] | None = None) -> Joint[AnySchedule]:
        """Return the best of the one-sided answers, of turns from there and, where weights can be relaxed, of what they lead to."""
        start_time = perf_counter()
        self.report("path first, and sensors first")
        one_sided = one_sided_answers(joint_problem, self.starts, self.executor)
        self.report("path and schedule in turn, from both")
        pairs = [AlternationStart(joint_problem, answer.name, answer.pair) for answer in one_sided if answer.pair is not None]
        results = self.improve(pairs)
        rounded_results = relax(results) if relax is not None and results else []
        self.report("the best of all, with a proven schedule")
        joint = _build_joint(joint_problem, one_sided, results, rounded_results)
        return replace(joint, seconds=perf_counter() - start_time)

    def improve(self, pairs: Sequence[AlternationStart[AnySchedule]]) -> list[AlternationResult[AnySchedule]]:
        """Return where turns lead to."""
        return list(self.apply(alternate, pairs))

    @property
    def apply(self) -> Callable[..., Any]:
        """What maps tasks."""
        return map if self.executor is None else self.executor.map


def _solve_for_start(search: _JointSearch, joint_problem: JointProblem) -> Joint[Schedule]:
    """Return the same, with turns from where climbs in path and weights together lead to."""

    def relax(results: Sequence[AlternationResult[Schedule]]) -> list[AlternationResult[Schedule]]:
        """Return where turns lead to from the best rounded climbs."""
        search.report(f"path and schedule at once, from these and from {search.starts} other paths")
        return search.improve(best_distinct(search.apply(round_relaxation, relaxations(joint_problem, results, search.starts))))

    return search.solve(joint_problem, relax)


# ---------------------------------------------------------------- the answer


def _build_joint(
    joint_problem: AbstractJointProblem[AnySchedule],
    one_sided: tuple[OneSidedAnswer[AnySchedule], OneSidedAnswer[AnySchedule]],
    results: Sequence[AlternationResult[AnySchedule]],
    rounded_results: Sequence[AlternationResult[AnySchedule]],
) -> Joint[AnySchedule]:
    first, second = (answer.record for answer in one_sided)
    if not results:
        unanswered = one_sided[0] if not one_sided[0].design.ended.has_answer else one_sided[1]
        status = unanswered.schedule.status if unanswered.design.ended.has_answer else unanswered.design.ended
        status = Status.NUMERICAL_ERROR if status.has_answer else status
        return Joint(unanswered.design, unanswered.schedule, np.nan, np.nan, first, second, (), "", np.nan, status, 0.0)
    best = certify(joint_problem, max((*results, *rounded_results), key=lambda result: result.pair.objective))  # the first of equals
    pair, alternated = best.pair, max(result.pair.objective for result in results)
    status = Status.LOCALLY_OPTIMAL if best.is_stationary else Status.GAP_OPEN
    design = design_for_schedule(joint_problem, pair)
    value = joint_problem.recorded_value(pair.path, pair.schedule, pair.penalty)
    return Joint(design, pair.schedule, value, pair.objective, first, second, best.values, best.origin, alternated, status, 0.0)


def design_for_schedule(joint_problem: AbstractJointProblem[AnySchedule], pair: Pair[AnySchedule]) -> Design:
    """Return the design as one for the pair's schedule: the last turn may have found another than it was made for."""
    problem, design = joint_problem.with_schedule(pair.schedule.chosen), pair.design
    if design.problem == problem:
        return design
    value = problem.value(pair.path)
    low = np.linalg.eigvalsh(problem.matrix(pair.path))[:2]
    eigenvalues = (float(low[0]), float(low[-1]))
    objective = value - joint_problem.path_price(pair.path)
    return replace(design, problem=problem, value=value, objective=objective, eigenvalues=eigenvalues, cap=cap_of(problem))
