"""The main job: analyse, design, select, validate, in that order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import combinations
from time import perf_counter

import numpy as np

from obsdesign.analysis.question import observability_of
from obsdesign.analysis.verdict import Verdict
from obsdesign.design.limits import is_feasible
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design
from obsdesign.design.shaping import design_trajectory
from obsdesign.design.weave import Weave, best_weave
from obsdesign.information.gramian import variational_gramian
from obsdesign.information.record import Information, standard_deviations
from obsdesign.information.shares import Contributions, contributions
from obsdesign.scenario.schema import Scenario
from obsdesign.selection.naive import always, at_random, round_robin
from obsdesign.selection.relaxation import select_sensors
from obsdesign.selection.schedule import Schedule, schedule_value
from obsdesign.simulation import simulate
from obsdesign.system import System
from obsdesign.trajectory import Trajectory
from obsdesign.validation import Validation, validate

RANDOM_SCHEDULES = 1000
STRAIGHT, WEAVE, DESIGNED, CHOSEN = "straight", "weave", "designed", "chosen"  # names of paths and of the schedule
Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Analysis:
    """What one suite of sensors can see in one manoeuvre."""

    manoeuvre: str
    sensors: tuple[str, ...]
    verdict: Verdict


@dataclass(frozen=True, eq=False)
class Quality:
    """How well one suite of sensors sees the start state along one path, without a prior.

    value: the criterion of S W S; eigenvalues (n,) of S W S, ascending, and vectors (n, n), its unit eigenvectors in columns, in
    scaled states; std (n,): Cramer-Rao bound per state in its unit, inf for a state that stays hidden.
    """

    sensors: tuple[str, ...]
    value: float
    eigenvalues: np.ndarray
    std: np.ndarray
    vectors: np.ndarray

    @property
    def weakest(self) -> np.ndarray:
        """Unit eigenvector (n,) of the smallest eigenvalue: what is known least."""
        return self.vectors[:, 0]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A path, its quality for each suite (all sensors first), who says what, and whether it satisfies the design's constraints."""

    name: str
    path: Trajectory
    information: Information
    qualities: tuple[Quality, ...]
    contributions: Contributions
    feasible: bool


@dataclass(frozen=True, eq=False)
class Rival:
    """A naive schedule (K, S) and its value."""

    name: str
    chosen: np.ndarray
    value: float


@dataclass(frozen=True, eq=False)
class Selection:
    """The schedule for the designed path, and what one would have done without thinking.

    random_values: values of a thousand random schedules, sorted.
    """

    schedule: Schedule
    rivals: tuple[Rival, ...]
    random_values: np.ndarray


@dataclass(frozen=True, eq=False)
class Check:
    """Filter runs on one path under one schedule."""

    path: str
    schedule: str
    chosen: np.ndarray
    validation: Validation


@dataclass(frozen=True, eq=False)
class Study:
    """The four answers. designs[0] is for all sensors and is the path that selection and validation use."""

    scenario: Scenario
    seed: int
    analyses: tuple[Analysis, ...]
    designs: tuple[Design, ...]
    weave: Weave | None
    candidates: tuple[Candidate, ...]
    selection: Selection
    checks: tuple[Check, ...]
    seconds: Mapping[str, float]

    @property
    def suites(self) -> tuple[tuple[str, ...], ...]:
        """The sensor suites that are reported: all sensors first."""
        return suites_of(self.scenario)

    def candidate(self, name: str) -> Candidate:
        """Return the candidate of that name."""
        return next(candidate for candidate in self.candidates if candidate.name == name)

    def check(self, path: str, schedule: str) -> Check:
        """Return the filter check of that path and schedule."""
        return next(check for check in self.checks if (check.path, check.schedule) == (path, schedule))


def run(scenario: Scenario, seed: int | None = None, executor: Executor | None = None, progress: Progress | None = None) -> Study:
    """Answer the four questions of a scenario. seed: None = the scenario's.

    Raises UnobservableError when no path can make the state visible, SolveError when a solver fails, InputError for a
    scenario whose values do not fit together.
    """
    seed = scenario.seed if seed is None else seed
    tell = progress or (lambda _: None)
    seconds: dict[str, float] = {}
    began = perf_counter()

    def stage(name: str, what: str) -> None:
        nonlocal began
        if name:
            seconds[name] = perf_counter() - began
        began = perf_counter()
        if what:
            tell(what)

    system = scenario.system
    stage("", "Can it? The observable space of every suite of sensors")
    problems = tuple(_problem(scenario, suite) for suite in suites_of(scenario))
    analyses = analyse(scenario, seed)
    stage("analyse", f"How? {scenario.design.starts} starts for each of {len(problems)} suites, and the best weave")
    designs = tuple(design_trajectory(problem, scenario.design.starts, seed, executor) for problem in problems)
    weave, candidates = _candidates(scenario, problems, designs)
    stage("design", f"Which? {scenario.segments} segments, {scenario.selection.per_segment} of {len(scenario.sensors)} sensors on")
    selection = select(scenario, designs[0], seed)
    stage("select", f"Does it hold? {scenario.validation.runs} filter runs for each of 4 cases")
    checks = tuple(_checks(scenario, system, candidates, selection, seed, executor))
    stage("validate", "")
    return Study(scenario, seed, analyses, designs, weave, candidates, selection, checks, seconds)


def suites_of(scenario: Scenario) -> tuple[tuple[str, ...], ...]:
    """All sensors, then the suites that the scenario names."""
    everything = scenario.sensor_names
    return (everything, *(suite for suite in scenario.design.suites if set(suite) != set(everything)))


def start_of(scenario: Scenario) -> np.ndarray:
    """x(t_0) (n,)."""
    return np.array([scenario.start[name] for name in scenario.state_names])


def analyse(scenario: Scenario, seed: int) -> tuple[Analysis, ...]:
    """Return a verdict at the start state for every manoeuvre and every subset of the sensors."""
    model, names = scenario.system.model, scenario.sensor_names
    subsets = [subset for size in range(1, len(names) + 1) for subset in combinations(names, size)]
    return tuple(
        Analysis(manoeuvre.name, subset, observability_of(model.only(subset), at=start_of(scenario), held=manoeuvre.held, seed=seed))
        for manoeuvre in scenario.manoeuvres
        for subset in subsets
    )


def select(scenario: Scenario, design: Design, seed: int) -> Selection:
    """Choose the sensors along a designed path, and rate the naive schedules."""
    K, S, m = scenario.segments, len(scenario.sensors), scenario.selection.per_segment
    if design.information is None:
        raise ValueError("a design without a path has no schedule")
    blocks = design.problem.scaled(design.information.by_segment(K))
    fixed = naive_sensor(scenario)
    rivals = [(f"{fixed} always", always(K, S, scenario.sensor_names.index(fixed))), ("round robin", round_robin(K, S, m))]
    random = np.random.default_rng([seed, 1])
    values = [schedule_value(blocks, at_random(K, S, m, random)) for _ in range(RANDOM_SCHEDULES)]
    return Selection(
        schedule=select_sensors(blocks, m, seed=seed),
        rivals=tuple(Rival(name, chosen, schedule_value(blocks, chosen)) for name, chosen in rivals),
        random_values=np.sort(values),
    )


def naive_sensor(scenario: Scenario) -> str:
    """The sensor that the naive schedule keeps on."""
    return scenario.selection.naive or scenario.sensor_names[0]


def rate(problem: DesignProblem, path: Trajectory, information: Information, sensors: tuple[str, ...]) -> Quality:
    """Return the quality of a path for the suite of sensors that the problem is about."""
    W = information.only(*sensors).total
    eigenvalues, vectors = np.linalg.eigh(problem.scaled(W))
    return Quality(sensors, problem.value(path), eigenvalues, standard_deviations(W), vectors)


def _problem(scenario: Scenario, suite: tuple[str, ...]) -> DesignProblem:
    system = scenario.system
    kept = tuple(sensor for name, sensor in zip(system.sensor_names, system.sensors, strict=True) if name in suite)
    return DesignProblem(
        system=System(system.vehicle, kept),
        start=start_of(scenario),
        duration=scenario.time.duration,
        step=scenario.time.step,
        path=scenario.design.path,
        bounds=scenario.design.bounds,
        criterion=scenario.criterion,
        scale=[scenario.prior[name] for name in scenario.state_names],
        constraints=scenario.design.constraints,
    )


def _candidates(
    scenario: Scenario, problems: tuple[DesignProblem, ...], designs: tuple[Design, ...]
) -> tuple[Weave | None, tuple[Candidate, ...]]:
    """The constant inputs, the best weave, the designed path, and the paths designed for other suites."""
    everything, system = problems[0], scenario.system
    idle = np.clip(0.0, everything.lower, everything.upper)
    straight = simulate(system, everything.x0, np.tile(idle, (everything.steps, 1)), everything.step)
    found = best_weave(everything) if "turn_rate" in system.model.input_names else None
    paths = {STRAIGHT: straight}
    if found is not None:
        paths[WEAVE] = found[1]
    for suite, design in zip(suites_of(scenario), designs, strict=True):
        name = DESIGNED if design is designs[0] else f"{DESIGNED} for {' + '.join(suite)}"
        if design.trajectory is not None:
            paths[name] = design.trajectory
    candidates = tuple(_candidate(scenario, problems, name, path) for name, path in paths.items())
    return None if found is None else found[0], candidates


def _candidate(scenario: Scenario, problems: tuple[DesignProblem, ...], name: str, path: Trajectory) -> Candidate:
    information = variational_gramian(problems[0].system, path)
    qualities = tuple(rate(problem, path, information, suite) for problem, suite in zip(problems, suites_of(scenario), strict=True))
    said = contributions(problems[0].system, information, scenario.segments, problems[0].units)
    return Candidate(name, path, information, qualities, said, is_feasible(problems[0], path))


def _checks(
    scenario: Scenario, system: System, candidates: tuple[Candidate, ...], selection: Selection, seed: int, executor: Executor | None
) -> Iterator[Check]:
    paths = {candidate.name: candidate.path for candidate in candidates}
    schedules = {CHOSEN: selection.schedule.chosen, selection.rivals[0].name: selection.rivals[0].chosen}
    for path in (DESIGNED, STRAIGHT):
        for name, chosen in schedules.items():
            found = validate(
                system,
                paths[path],
                chosen,
                prior=scenario.prior_at_start,
                runs=scenario.validation.runs,
                seed=seed,
                executor=executor,
                disturbance_psd=scenario.disturbance_psd,
            )
            yield Check(path, name, chosen, found)
