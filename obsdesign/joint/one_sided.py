"""One-sided answers: the path first, or the sensors first."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Generic

import numpy as np

from obsdesign.design.initial_guesses import TURN_RATE, shortest_inputs, start_inputs
from obsdesign.design.multistart import design_trajectory
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design
from obsdesign.errors import InputError
from obsdesign.joint.abstract import AbstractJointProblem
from obsdesign.joint.alternation import Pair, make_pair
from obsdesign.joint.result import AnySchedule, OneSided
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class OneSidedAnswer(Generic[AnySchedule]):
    """A one-sided answer, and the pair that it is; None without an answer."""

    name: str
    design: Design
    schedule: AnySchedule
    pair: Pair[AnySchedule] | None

    @property
    def record(self) -> OneSided[AnySchedule]:
        """The public record: NaN for value and objective where there is no pair."""
        if self.pair is None:
            return OneSided(self.design, self.schedule, np.nan, np.nan)
        value = self.pair.objective + (self.design.value - self.design.objective)
        return OneSided(self.design, self.schedule, value, self.pair.objective)


def one_sided_answers(
    joint_problem: AbstractJointProblem[AnySchedule], starts: int, executor: Executor | None
) -> tuple[OneSidedAnswer[AnySchedule], OneSidedAnswer[AnySchedule]]:
    """Return the path designed for all sensors with the best schedule for it, and the best schedule of a plain path with its own path."""
    path = design_trajectory(joint_problem.problem, starts, joint_problem.seed, executor, throw=False)
    baseline, baseline_schedule = _baseline_schedule(joint_problem)
    problem = joint_problem.with_schedule(baseline_schedule.chosen) if baseline_schedule.status.has_answer else joint_problem.problem
    design = design_trajectory(problem, starts, joint_problem.seed, executor, throw=False)
    schedule = baseline_schedule if path.trajectory is None else joint_problem.select_schedule(path.trajectory, proven=True)
    return _one_sided(joint_problem, "path first", path, schedule, path.trajectory), _one_sided(
        joint_problem, "sensors first", design, baseline_schedule, baseline
    )


def _one_sided(
    joint_problem: AbstractJointProblem[AnySchedule], name: str, design: Design, schedule: AnySchedule, origin: Trajectory | None
) -> OneSidedAnswer[AnySchedule]:
    """origin: the path that the schedule was selected on."""
    path = design.trajectory
    if path is None or origin is None or not schedule.status.has_answer or not joint_problem.allows(path, schedule.chosen):
        return OneSidedAnswer(name, design, schedule, None)
    return OneSidedAnswer(
        name, design, schedule, make_pair(joint_problem, design, path, schedule, joint_problem.switching_penalty(origin, schedule))
    )


def _baseline_schedule(joint_problem: AbstractJointProblem[AnySchedule]) -> tuple[Trajectory, AnySchedule]:
    """Return the path that one takes without thinking and the best schedule for it; another where that one meets a landmark."""
    problem = joint_problem.problem
    for u in _baselines(problem, joint_problem.seed):
        path = problem.path_along(u)
        try:
            joint_problem.require_information(path)
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
