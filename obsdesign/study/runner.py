"""Answering the questions of a scenario."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import replace
from itertools import combinations
from logging import getLogger
from time import perf_counter

from obsdesign.analysis.query import observability_of
from obsdesign.arguments import validate_arguments
from obsdesign.blas_threads import one_thread
from obsdesign.checks import whole_multiple
from obsdesign.design.multistart import design_trajectory
from obsdesign.design.problem import DesignProblem
from obsdesign.errors import InputError
from obsdesign.estimation.validation import validate
from obsdesign.joint.joint_solver import codesign
from obsdesign.joint.result import AnyJoint
from obsdesign.planning.closed_loop import Flight, fly
from obsdesign.progress import Progress, StageReport
from obsdesign.scenario.path_names import DESIGNED, GIVEN
from obsdesign.scenario.schema import Scenario
from obsdesign.study.candidate_paths import candidate_of, candidates_of
from obsdesign.study.problem import problem_along, problem_of, scenario_paths, start_of
from obsdesign.study.record import CHOSEN, Analysis, Candidate, FilterCheck, Selection, Study, baseline_of, schedule_at_steps, suites_of
from obsdesign.study.schedules import select
from obsdesign.trajectory import Trajectory

_LOGGER = getLogger(__name__)


@validate_arguments
@one_thread()
def run(scenario: Scenario, seed: int | None = None, executor: Executor | None = None, progress: Progress | None = None) -> Study:
    """Answer the questions of a scenario: what the sensors see, which path, which schedule, what a filter makes of them.

    Arguments:
        scenario: what is asked, as load_scenario returns it.
        seed: seed of everything that is drawn; None = the scenario's.
        executor: any concurrent.futures.Executor of processes; the answer is the same for any number of them.
        progress: is called with what is being done, as it begins; None = nobody is told.
    Raises UnobservableError when no path can make the state visible, SolveError when a solver fails or no path satisfies the
    limits, InputError for a scenario whose values do not fit together.
    """
    seed = scenario.seed if seed is None else seed
    _ = start_of(scenario)  # refuses a scenario of which verdicts alone are asked
    if scenario.paths:
        return _run_along(scenario, seed, executor, progress)
    stage = _Stages(progress)
    stage("", "Can it? The observable space of every suite of sensors")
    problems = tuple(problem_of(scenario, suite) for suite in suites_of(scenario))
    analyses = analyse(scenario, seed)
    design = scenario.design
    stage("analyse", f"How? {design.starts} starts for each of {len(problems)} suites, and the best weave")
    designs = tuple(
        design_trajectory(problem, design.starts, seed, executor, evidence=design.evidence, gap=design.gap, progress=stage.report.within)
        for problem in problems
    )
    weave, candidates = candidates_of(scenario, designs)
    designed_path = next(candidate for candidate in candidates if candidate.name == DESIGNED)
    segments, sensors = len(designed_path.nodes) - 1, len(scenario.sensor_names)
    stage("design", f"Which? {segments} segments, {scenario.selection.per_segment} of {sensors} sensors on")
    selection = select(scenario, designed_path, designs[0].problem, seed, stage.report.within)
    stage("select", "" if scenario.codesign is None else "Together? Path and schedule at once")
    joint = _codesign(scenario, problems[0], seed, executor, stage.report.within)
    stage(
        "codesign" if joint is not None else "",
        f"Does it hold? {scenario.validation.runs} filter runs for each of {4 + len(selection.others)} cases",
    )
    cases = tuple(next(candidate for candidate in candidates if candidate.name == name) for name in (DESIGNED, baseline_of(scenario)))
    checks = tuple(_checks(scenario, cases, selection, seed, executor, stage.report.within))
    stage("validate", "" if scenario.flight is None else f"In flight? A new plan every {scenario.flight.every:g} s")
    flight = _flight(scenario, problems[0], seed, stage.report.within)
    stage("fly" if flight is not None else "", "")
    return Study(scenario, seed, analyses, problems, designs, weave, candidates, selection, checks, stage.seconds, flight, joint)


class _Stages:
    """Tells of each stage when it begins, and keeps how long each took."""

    def __init__(self, progress: Progress | None) -> None:
        self.report = StageReport(_LOGGER, progress)
        self._start = perf_counter()
        self.seconds: dict[str, float] = {}

    def __call__(self, name: str, what: str) -> None:
        if name:
            self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - self._start
        self._start = perf_counter()
        if what:
            self.report(what)


def _run_along(scenario: Scenario, seed: int, executor: Executor | None, progress: Progress | None) -> Study:
    """Answer the questions of a scenario whose paths are given."""
    stage = _Stages(progress)
    stage("", "Can it? The observable space of every suite of sensors")
    analyses, paths = analyse(scenario, seed), scenario_paths(scenario)
    problems = tuple(problem_along(scenario, suite, tuple(paths.values())) for suite in suites_of(scenario))
    stage("analyse", f"How well? {len(paths)} given paths")
    candidates = tuple(candidate_of(scenario, problems, name, path) for name, path in paths.items())
    stage("rate", "")
    studies: list[Study] = []
    for case in candidates:
        on = f"{scenario.selection.per_segment} of {len(scenario.sensor_names)} sensors on"
        stage("", f"Which? {case.name}: {len(case.nodes) - 1} segments, {on}")
        selection = select(scenario, case, problems[0], seed, stage.report.within)
        stage("select", f"Does it hold? {scenario.validation.runs} filter runs for each of {2 + len(selection.others)} cases")
        checks = tuple(_checks(scenario, (case,), selection, seed, executor, stage.report.within))
        stage("validate", "")
        studies.append(Study(scenario, seed, analyses, problems, (), None, candidates, selection, checks, stage.seconds, about=case.name))
    return replace(studies[0], others=tuple(studies[1:]))


@one_thread()
def select_along(scenario: Scenario, path: Trajectory, seed: int | None = None, notes: tuple[str, ...] = ()) -> Study:
    """Choose the sensors of a scenario along a path of its vehicle, and nothing else; its design does not count.

    Raises InputError for a path whose step does not fit the scenario's segments and sensors, or that is shorter than a segment.
    """
    seed, segment = scenario.seed if seed is None else seed, scenario.time.segment
    if whole_multiple(segment, path.step) is None:
        raise InputError(f"the path has steps of {path.step:g} s: time.segment, {segment:g} s, must be a whole multiple of them")
    if path.steps * path.step < segment:
        raise InputError(f"the path takes {path.steps * path.step:g} s: must be at least one segment, {segment:g} s")
    stage = _Stages(None)
    problems = tuple(problem_along(scenario, suite, (path,), constraints=False) for suite in suites_of(scenario))
    candidate = candidate_of(scenario, problems, GIVEN, path)
    selection = select(scenario, candidate, problems[0], seed)
    stage("select", "")
    return Study(scenario, seed, (), problems, (), None, (candidate,), selection, (), stage.seconds, about=GIVEN, notes=notes)


def analyse(scenario: Scenario, seed: int) -> tuple[Analysis, ...]:
    """Return a verdict at the start state for every manoeuvre and every subset of the sensors."""
    model, names = scenario.system.model, scenario.sensor_names
    subsets = [subset for size in range(1, len(names) + 1) for subset in combinations(names, size)]
    return tuple(
        Analysis(manoeuvre.name, subset, observability_of(model.only(subset), at=start_of(scenario), held=manoeuvre.held, seed=seed))
        for manoeuvre in scenario.manoeuvres
        for subset in subsets
    )


def _codesign(
    scenario: Scenario, problem: DesignProblem, seed: int, executor: Executor | None, progress: Progress | None
) -> AnyJoint | None:
    settings, selection = scenario.codesign, scenario.selection
    if settings is None:
        return None
    question = scenario.codesign_question
    return codesign(
        replace(problem, criterion=scenario.codesign_criterion),
        scenario.segments,
        selection.per_segment,
        scenario.rules_for(question),
        question=question,
        starts=settings.starts,
        seed=seed,
        executor=executor,
        gap=settings.gap,
        progress=progress,
    )


def _flight(scenario: Scenario, problem: DesignProblem, seed: int, progress: Progress | None) -> Flight | None:
    settings = scenario.flight
    if settings is None:
        return None
    return fly(
        problem,
        scenario.prior_at_start,
        every=settings.every,
        duration=settings.duration,
        disturbance_psd=scenario.disturbance_psd,
        input_psd=scenario.input_psd,
        seed=seed,
        horizon=settings.horizon,
        progress=progress,
    )


def _checks(
    scenario: Scenario,
    cases: tuple[Candidate, ...],
    selection: Selection,
    seed: int,
    executor: Executor | None,
    progress: Progress | None,
) -> Iterator[FilterCheck]:
    """Filter runs on each path, with the chosen schedule and with the naive one; on the first with those of the other questions too."""
    schedules = {CHOSEN: selection.chosen, selection.rivals[0].name: selection.rivals[0].chosen}
    for case in cases:
        for name, chosen in (schedules | selection.others if case is cases[0] else schedules).items():
            validation = validate(
                scenario.system,
                case.path,
                schedule_at_steps(chosen, case.nodes),
                prior=scenario.prior_at_start,
                runs=scenario.validation.runs,
                seed=seed,
                executor=executor,
                disturbance_psd=scenario.disturbance_psd,
                input_psd=scenario.input_psd,
                progress=progress,
            )
            yield FilterCheck(case.name, name, chosen, validation)
