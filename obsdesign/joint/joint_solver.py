"""Path and schedule together: one-sided answers, turns, relaxed climbs, and the best of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from logging import getLogger
from time import perf_counter
from typing import Any

import numpy as np

from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count
from obsdesign.design.initial_guesses import TURN_RATE, shortest_inputs, start_inputs
from obsdesign.design.multistart import design_trajectory
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design
from obsdesign.design.upper_bound import cap_of
from obsdesign.errors import InputError, SolveError
from obsdesign.joint.alternation import AlternationResult, AlternationStart, Pair, alternate, certify, make_pair
from obsdesign.joint.joint_relaxation import best_distinct, relaxations, round_relaxation
from obsdesign.joint.problem import JointProblem
from obsdesign.joint.result import Joint, OneSided
from obsdesign.progress import Progress, StageReport
from obsdesign.rules.abstract import AbstractRule
from obsdesign.selection.schedule import Schedule
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

_LOGGER = getLogger(__name__)
ROUNDS = 20  # of path, then schedule; a few settle it


@validate_arguments
def codesign(
    problem: DesignProblem,
    segments: int,
    per_segment: int = 1,
    rules: tuple[AbstractRule, ...] = (),
    *,
    starts: int = 8,
    rounds: int = ROUNDS,
    seed: int = 0,
    executor: Executor | None = None,
    throw: bool = True,
    progress: Progress | None = None,
) -> Joint:
    """Choose a path and a schedule of its sensors together.

    max over paths p and schedules s of criterion(S (sum_ks s_ks W_ks(p)) S), at most per_segment sensors on in each of K segments.
    Both one-sided answers come first. From each, path and schedule are improved in turn; then from there, and from `starts` other
    paths, both are optimised together with weights s in [0, 1] and are rounded by the selection on the path so found; the best few are
    improved in turn again. The answer is the best of all, so never below a one-sided one; it is a local optimum.

    Arguments:
        problem: the design problem, of one duration.
        segments: number K of equal segments, which divides the steps.
        per_segment: how many sensors may be on at a time.
        rules: what schedules have to keep, as for select_sensors.
        starts: number of other paths that the joint search begins from.
        rounds: largest number of turns of path and schedule.
        seed: seed of these paths.
        executor: runs the local solves, one task each; the answer is the same for any number of workers.
        throw: False = return a failed Joint instead of raising SolveError.
        progress: is called with what is being done, as it begins; None = nobody is told.
    Raises InputError for a range of durations, a criterion that is not additive over sensors, segments that do not divide the
    steps; UnobservableError, and SolveError where no path and schedule were found.
    """
    require_count("starts", starts)
    joint_problem = JointProblem(problem, segments, per_segment, tuple(rules), seed, rounds)
    start_time = perf_counter()
    apply: Callable[..., Any] = map if executor is None else executor.map
    report = StageReport(_LOGGER, progress)
    report("path first, and sensors first")
    one_sided = _one_sided_answers(joint_problem, starts, executor)
    report("path and schedule in turn, from both")
    results = list(
        apply(alternate, [AlternationStart(joint_problem, answer.name, answer.pair) for answer in one_sided if answer.pair is not None])
    )
    report(f"path and schedule at once, from these and from {starts} other paths")
    rounded_results = (
        list(apply(alternate, best_distinct(apply(round_relaxation, relaxations(joint_problem, results, starts))))) if results else []
    )
    report("the best of all, with a proven schedule")
    joint = _build_joint(joint_problem, one_sided, results, rounded_results)
    joint = replace(joint, seconds=perf_counter() - start_time)
    if throw and not joint.status.has_answer:
        raise SolveError("codesign", joint.status, joint.design.reason)
    return joint


# ---------------------------------------------------------------- one-sided answers


@dataclass(frozen=True, eq=False)
class _OneSidedAnswer:
    """A one-sided answer, and the pair that it is; None without an answer."""

    name: str
    design: Design
    schedule: Schedule
    pair: Pair | None

    @property
    def record(self) -> OneSided:
        """The public record: NaN for value and objective where there is no pair."""
        if self.pair is None:
            return OneSided(self.design, self.schedule, np.nan, np.nan)
        value = self.pair.objective + (self.design.value - self.design.objective)
        return OneSided(self.design, self.schedule, value, self.pair.objective)


def _one_sided_answers(joint_problem: JointProblem, starts: int, executor: Executor | None) -> tuple[_OneSidedAnswer, _OneSidedAnswer]:
    path = design_trajectory(joint_problem.problem, starts, joint_problem.seed, executor, throw=False)
    baseline, baseline_schedule = _baseline_schedule(joint_problem)
    problem = joint_problem.with_schedule(baseline_schedule.chosen) if baseline_schedule.status.has_answer else joint_problem.problem
    design = design_trajectory(problem, starts, joint_problem.seed, executor, throw=False)
    schedule = baseline_schedule if path.trajectory is None else joint_problem.select_schedule(path.trajectory, proven=True)
    return _one_sided(joint_problem, "path first", path, schedule, path.trajectory), _one_sided(
        joint_problem, "sensors first", design, baseline_schedule, baseline
    )


def _one_sided(joint_problem: JointProblem, name: str, design: Design, schedule: Schedule, origin: Trajectory | None) -> _OneSidedAnswer:
    """origin: the path that the schedule was selected on."""
    path = design.trajectory
    if path is None or origin is None or not schedule.status.has_answer or not joint_problem.allows(path, schedule.chosen):
        return _OneSidedAnswer(name, design, schedule, None)
    return _OneSidedAnswer(
        name, design, schedule, make_pair(joint_problem, design, path, schedule, joint_problem.switching_penalty(origin, schedule))
    )


def _baseline_schedule(joint_problem: JointProblem) -> tuple[Trajectory, Schedule]:
    """Return the path that one takes without thinking and the best schedule for it; another where that one meets a landmark."""
    problem = joint_problem.problem
    for u in _baselines(problem, joint_problem.seed):
        path = problem.path_along(u)
        try:
            joint_problem.blocks(path)
        except InputError:
            continue
        return path, joint_problem.select_schedule(path, proven=True)
    raise AssertionError("there is always another start")


def _baselines(problem: DesignProblem, seed: int) -> Iterator[np.ndarray]:
    """Inputs (N, m) of the shortest path, of the straight one, and of the other starts."""
    names, straight = problem.system.model.input_names, np.tile((problem.lower + problem.upper) / 2, (problem.steps, 1))
    if TURN_RATE in names:
        shortest = shortest_inputs(problem)
        if shortest is not None:
            yield shortest
        column = names.index(TURN_RATE)
        straight[:, column] = np.clip(0.0, problem.lower[column], problem.upper[column])
    yield straight
    yield from (u for _, u in start_inputs(problem, seed))


# ---------------------------------------------------------------- the answer


def _build_joint(
    joint_problem: JointProblem,
    one_sided: tuple[_OneSidedAnswer, _OneSidedAnswer],
    results: Sequence[AlternationResult],
    rounded_results: Sequence[AlternationResult],
) -> Joint:
    first, second = (answer.record for answer in one_sided)
    if not results:
        unanswered = one_sided[0] if not one_sided[0].design.status.has_answer else one_sided[1]
        status = unanswered.schedule.status if unanswered.design.status.has_answer else unanswered.design.status
        status = Status.NUMERICAL_ERROR if status.has_answer else status
        return Joint(unanswered.design, unanswered.schedule, np.nan, np.nan, first, second, (), "", np.nan, status, 0.0)
    best = certify(joint_problem, max((*results, *rounded_results), key=lambda result: result.pair.objective))  # the first of equals
    pair, alternated = best.pair, max(result.pair.objective for result in results)
    status = Status.LOCALLY_OPTIMAL if best.is_stationary else Status.GAP_OPEN
    design = design_for_schedule(joint_problem, pair)
    value = pair.schedule.value
    return Joint(design, pair.schedule, value, pair.objective, first, second, best.values, best.origin, alternated, status, 0.0)


def design_for_schedule(joint_problem: JointProblem, pair: Pair) -> Design:
    """Return the design as one for the pair's schedule: the last turn may have found another than it was made for."""
    problem, design = joint_problem.with_schedule(pair.schedule.chosen), pair.design
    if design.problem == problem:
        return design
    value = problem.value(pair.path)
    low = np.linalg.eigvalsh(problem.matrix(pair.path))[:2]
    eigenvalues = (float(low[0]), float(low[-1]))
    objective = value - joint_problem.path_price(pair.path)
    return replace(design, problem=problem, value=value, objective=objective, eigenvalues=eigenvalues, cap=cap_of(problem))
