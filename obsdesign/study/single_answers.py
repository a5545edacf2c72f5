"""One question of a scenario by itself: how to move; does it hold."""

from __future__ import annotations

from concurrent.futures import Executor

import numpy as np

from obsdesign.blas_threads import one_thread
from obsdesign.design.multistart import design_trajectory
from obsdesign.design.record import Design
from obsdesign.errors import InputError
from obsdesign.estimation.validation import Validation, validate
from obsdesign.progress import Progress
from obsdesign.scenario.schema import Scenario
from obsdesign.study.problem import problem_of, scenario_paths
from obsdesign.study.record import suites_of
from obsdesign.trajectory import Trajectory


@one_thread()
def design_paths(scenario: Scenario, seed: int, executor: Executor | None, progress: Progress | None) -> dict[tuple[str, ...], Design]:
    """Return the path designed for each suite of sensors of a scenario, all sensors first.

    Raises InputError where paths are given instead, and what design_trajectory raises.
    """
    if scenario.design.path is None:
        raise InputError("design.path: missing key: nothing is designed where [[paths]] are given; `obsdesign run` rates them")
    settings = scenario.design
    return {
        suite: design_trajectory(
            problem_of(scenario, suite), settings.starts, seed, executor, evidence=settings.evidence, gap=settings.gap, progress=progress
        )
        for suite in suites_of(scenario)
    }


@one_thread()
def path_to_validate(scenario: Scenario, seed: int, executor: Executor | None, progress: Progress | None) -> tuple[str, Trajectory]:
    """Return the name and the path that a scenario is about: the first that is given, or the one designed for all sensors."""
    if scenario.paths:
        return next(iter(scenario_paths(scenario).items()))
    settings = scenario.design
    problem = problem_of(scenario, scenario.sensor_names)
    design = design_trajectory(problem, settings.starts, seed, executor, gap=settings.gap, progress=progress)
    if design.trajectory is None:
        raise InputError(f"no path to validate: {design.status.value}")
    return "designed", design.trajectory


@one_thread()
def validate_scenario(
    scenario: Scenario,
    path: Trajectory,
    segments: np.ndarray | None,
    seed: int,
    executor: Executor | None,
    progress: Progress | None,
) -> Validation:
    """Return the filter runs of a scenario along a path.

    segments (K, S): which sensors are on in each segment of time.segment; None = all of them, always. Raises InputError for a schedule
    that is shorter than the path.
    """
    return validate(
        scenario.system,
        path,
        None if segments is None else _at_steps(scenario, path, segments),
        prior=scenario.prior_at_start,
        runs=scenario.validation.runs,
        seed=seed,
        executor=executor,
        disturbance_psd=scenario.disturbance_psd,
        input_psd=scenario.input_psd,
        progress=progress,
    )


def _at_steps(scenario: Scenario, path: Trajectory, segments: np.ndarray) -> np.ndarray:
    """The schedule (N, S) at every step of a path."""
    begins = path.t[:-1] - path.t[0]
    segment = np.floor(begins / scenario.time.segment + 1e-9).astype(int)
    if segment[-1] >= len(segments):
        covered = len(segments) * scenario.time.segment
        raise InputError(f"the schedule covers {covered:g} s: must be at least the path's {path.t[-1] - path.t[0]:g} s")
    return segments[segment]
