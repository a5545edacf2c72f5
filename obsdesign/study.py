"""The main job: analyse, design, select, validate and, where asked, fly; in that order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import combinations
from time import perf_counter

import numpy as np

from obsdesign.analysis.question import observability_of
from obsdesign.analysis.verdict import Verdict
from obsdesign.constraints.abstract import AT_END
from obsdesign.costs._terms import Budget, Price
from obsdesign.design.limits import Shortfall, shortfalls
from obsdesign.design.problem import DesignProblem, Floor, Robust
from obsdesign.design.record import Design
from obsdesign.design.shaping import design_trajectory
from obsdesign.design.starts import shortest_inputs
from obsdesign.design.weave import Weave, best_weave
from obsdesign.flight import Flight, fly
from obsdesign.information.gramian import variational_gramian
from obsdesign.information.record import Information, standard_deviations
from obsdesign.information.shares import Contributions, contributions
from obsdesign.moment import Moment
from obsdesign.scenario.contradictions import DESIGNED, SHORTEST, STRAIGHT, WEAVE
from obsdesign.scenario.schema import Scenario
from obsdesign.selection.naive import always, at_random, round_robin
from obsdesign.selection.relaxation import select_sensors
from obsdesign.selection.schedule import Schedule, schedule_value
from obsdesign.simulation import simulate
from obsdesign.system import System
from obsdesign.trajectory import Trajectory
from obsdesign.validation import Validation, validate

RANDOM_SCHEDULES = 1000
CHOSEN = "chosen"  # the name of the schedule, as STRAIGHT, SHORTEST, WEAVE and DESIGNED are those of paths
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
    """A path, its quality for each suite (all sensors first), who says what, and which limits of the design it breaks.

    nodes (K+1,): where its K segments begin and end, in steps; the last may be shorter than the others.
    """

    name: str
    path: Trajectory
    information: Information
    nodes: np.ndarray
    qualities: tuple[Quality, ...]
    contributions: Contributions
    shortfalls: tuple[Shortfall, ...]

    @property
    def feasible(self) -> bool:
        """Whether it breaks no limit."""
        return not self.shortfalls

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.path.t[-1] - self.path.t[0])

    @property
    def blocks(self) -> np.ndarray:
        """Information (K, S, n, n) of each segment and sensor."""
        return np.add.reduceat(self.information.blocks, self.nodes[:-1], axis=0)


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
    """The answers. designs[0] is for all sensors and is the path that selection and validation use; flight: where one is asked for."""

    scenario: Scenario
    seed: int
    analyses: tuple[Analysis, ...]
    designs: tuple[Design, ...]
    weave: Weave | None
    candidates: tuple[Candidate, ...]
    selection: Selection
    checks: tuple[Check, ...]
    seconds: Mapping[str, float]
    flight: Flight | None = None

    @property
    def suites(self) -> tuple[tuple[str, ...], ...]:
        """The sensor suites that are reported: all sensors first."""
        return suites_of(self.scenario)

    @property
    def baseline(self) -> str:
        """Name of the path that one would take without thinking."""
        return baseline_of(self.scenario)

    @property
    def designed(self) -> Candidate:
        """The path designed for all sensors."""
        return self.candidate(DESIGNED)

    def candidate(self, name: str) -> Candidate:
        """Return the candidate of that name."""
        return next(candidate for candidate in self.candidates if candidate.name == name)

    def check(self, path: str, schedule: str) -> Check:
        """Return the filter check of that path and schedule."""
        return next(check for check in self.checks if (check.path, check.schedule) == (path, schedule))


def run(scenario: Scenario, seed: int | None = None, executor: Executor | None = None, progress: Progress | None = None) -> Study:
    """Answer the questions of a scenario. seed: None = the scenario's.

    Raises UnobservableError when no path can make the state visible, SolveError when a solver fails or no path satisfies the
    limits, InputError for a scenario whose values do not fit together.
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

    stage("", "Can it? The observable space of every suite of sensors")
    problems = tuple(problem_of(scenario, suite) for suite in suites_of(scenario))
    analyses = analyse(scenario, seed)
    design = scenario.design
    stage("analyse", f"How? {design.starts} starts for each of {len(problems)} suites, and the best weave")
    designs = tuple(design_trajectory(problem, design.starts, seed, executor, evidence=design.evidence) for problem in problems)
    weave, candidates = _candidates(scenario, designs)
    designed = next(each for each in candidates if each.name == DESIGNED)
    segments, sensors = len(designed.nodes) - 1, len(scenario.sensors)
    stage("design", f"Which? {segments} segments, {scenario.selection.per_segment} of {sensors} sensors on")
    selection = select(scenario, designed, designs[0].problem, seed)
    stage("select", f"Does it hold? {scenario.validation.runs} filter runs for each of 4 cases")
    checks = tuple(_checks(scenario, candidates, selection, seed, executor))
    stage("validate", "" if scenario.flight is None else f"In flight? A new plan every {scenario.flight.every:g} s")
    flight = _flight(scenario, problems[0], seed)
    stage("fly" if flight is not None else "", "")
    return Study(scenario, seed, analyses, designs, weave, candidates, selection, checks, seconds, flight)


def suites_of(scenario: Scenario) -> tuple[tuple[str, ...], ...]:
    """All sensors, then the suites that the scenario names."""
    everything = scenario.sensor_names
    return (everything, *(suite for suite in scenario.design.suites if set(suite) != set(everything)))


def baseline_of(scenario: Scenario) -> str:
    """Name of the path that one would take without thinking: the first baseline, or the one of idle inputs."""
    return scenario.baselines[0].name if scenario.baselines else STRAIGHT


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


def select(scenario: Scenario, designed: Candidate, problem: DesignProblem, seed: int) -> Selection:
    """Choose the sensors along the designed path, and rate the naive schedules."""
    blocks = problem.scaled(designed.blocks)
    (K, S), m, naive = blocks.shape[:2], scenario.selection.per_segment, scenario.naive_sensors
    fixed = np.any([always(K, S, scenario.sensor_names.index(name)) for name in naive], axis=0)
    rivals = [(f"{' + '.join(naive)} always", fixed), ("round robin", round_robin(K, S, m))]
    random = np.random.default_rng([seed, 1])
    values = [schedule_value(blocks, at_random(K, S, m, random)) for _ in range(RANDOM_SCHEDULES)]
    return Selection(
        schedule=select_sensors(blocks, m, seed=seed),
        rivals=tuple(Rival(name, chosen, schedule_value(blocks, chosen)) for name, chosen in rivals),
        random_values=np.sort(values),
    )


def every_step(chosen: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Return (N, S): a schedule (K, S) at every step, its segments between nodes (K+1,)."""
    return np.repeat(chosen, np.diff(nodes), axis=0)


def rate(problem: DesignProblem, path: Trajectory, information: Information, sensors: tuple[str, ...]) -> Quality:
    """Return the quality of a path for the suite of sensors that the problem is about."""
    W = information.only(*sensors).total
    eigenvalues, vectors = np.linalg.eigh(problem.scaled(W))
    return Quality(sensors, problem.value(path), eigenvalues, standard_deviations(W), vectors)


def problem_of(scenario: Scenario, suite: tuple[str, ...]) -> DesignProblem:
    """Return what a scenario asks of the path for a suite of sensors."""
    system, design, time = scenario.system, scenario.design, scenario.time
    kept = tuple(sensor for name, sensor in zip(system.sensor_names, system.sensors, strict=True) if name in suite)
    robust, floor = design.robust, design.floor
    return DesignProblem(
        system=System(system.vehicle, kept),
        start=start_of(scenario),
        duration=time.duration if design.shortest is None else (design.shortest, time.duration),
        step=time.step,
        path=design.path,
        bounds=design.bounds,
        rates=design.rates,
        criterion=scenario.criterion,
        scale=[scenario.prior[name] for name in scenario.state_names],
        constraints=design.constraints,
        about=design.about,
        prices=tuple(Price(each.cost, each.per_unit) for each in design.prices),
        budgets=tuple(Budget(each.cost, each.at_most) for each in design.budgets),
        floor=None if floor is None else Floor(floor.seconds, floor.value),
        robust=None if robust is None else Robust(scenario.prior_at_start, robust.samples, robust.worst, robust.seed),
    )


def _flight(scenario: Scenario, problem: DesignProblem, seed: int) -> Flight | None:
    asked = scenario.flight
    if asked is None:
        return None
    return fly(
        problem,
        scenario.prior_at_start,
        every=asked.every,
        duration=asked.duration,
        disturbance_psd=scenario.disturbance_psd,
        seed=seed,
        horizon=asked.horizon,
    )


def _candidates(scenario: Scenario, designs: tuple[Design, ...]) -> tuple[Weave | None, tuple[Candidate, ...]]:
    """The naive paths, the best weave, the designed path, and the paths designed for other suites."""
    problem = designs[0].problem
    paths = {name: _held(problem, inputs) for name, inputs in _baselines(scenario).items()}
    shortest = _shortest(problem)
    if shortest is not None:
        paths[SHORTEST] = shortest
    found = best_weave(problem) if "turn_rate" in problem.system.model.input_names else None
    if found is not None:
        paths[WEAVE] = found[1]
    for suite, design in zip(suites_of(scenario), designs, strict=True):
        name = DESIGNED if design is designs[0] else f"{DESIGNED} for {' + '.join(suite)}"
        if design.trajectory is not None:
            paths[name] = design.trajectory
    candidates = tuple(_candidate(scenario, designs, name, path) for name, path in paths.items())
    return None if found is None else found[0], candidates


def _baselines(scenario: Scenario) -> dict[str, Mapping[str, float]]:
    return {STRAIGHT: {}} | {each.name: each.inputs for each in scenario.baselines}


def _held(problem: DesignProblem, inputs: Mapping[str, float]) -> Trajectory:
    """The path of constant inputs; those not named stay as near 0 as their bounds allow."""
    idle = dict(zip(problem.system.model.input_names, np.clip(0.0, problem.lower, problem.upper).tolist(), strict=True)) | inputs
    return simulate(problem.system, problem.x0, np.tile(list(idle.values()), (problem.steps, 1)), problem.step)


def _shortest(problem: DesignProblem) -> Trajectory | None:
    """The shortest way to the goal of a Dubins vehicle, up to the node that meets the goal best; None where there is none."""
    u = shortest_inputs(problem)
    if u is None:
        return None
    path = simulate(problem.system, problem.x0, u, problem.step)
    moment = Moment(dict(zip(problem.system.model.state_names, path.x[1:].T, strict=True)), {}, {}, problem.system.model.landmarks)
    margins = [margin for each in problem.constraints if each.span == AT_END for margin in each.margins(moment)]
    arrival = 1 + int(np.min(margins, axis=0).argmax())
    if problem.floor is not None:  # a path that is shorter than a stretch of it cannot be judged
        arrival = max(arrival, round(problem.floor.seconds / problem.step))
    return simulate(problem.system, problem.x0, u[:arrival], problem.step)


def _candidate(scenario: Scenario, designs: tuple[Design, ...], name: str, path: Trajectory) -> Candidate:
    problem, suites = designs[0].problem, suites_of(scenario)
    information = variational_gramian(problem.system, path)
    nodes = np.append(np.arange(0, path.steps, round(scenario.time.segment / scenario.time.step)), path.steps)
    qualities = tuple(rate(design.problem, path, information, suite) for design, suite in zip(designs, suites, strict=True))
    said = contributions(problem.system, information, None, problem.units)
    first = nodes[:-1]
    shares, weakest = np.add.reduceat(said.shares, first, axis=1), np.add.reduceat(said.weakest_shares, first, axis=0)
    said = replace(said, shares=shares, weakest_shares=weakest)
    return Candidate(name, path, information, nodes, qualities, said, shortfalls(problem, path))


def _checks(
    scenario: Scenario, candidates: tuple[Candidate, ...], selection: Selection, seed: int, executor: Executor | None
) -> Iterator[Check]:
    found = {candidate.name: candidate for candidate in candidates}
    schedules = {CHOSEN: selection.schedule.chosen, selection.rivals[0].name: selection.rivals[0].chosen}
    for path in (DESIGNED, baseline_of(scenario)):
        for name, chosen in schedules.items():
            validation = validate(
                scenario.system,
                found[path].path,
                every_step(chosen, found[path].nodes),
                prior=scenario.prior_at_start,
                runs=scenario.validation.runs,
                seed=seed,
                executor=executor,
                disturbance_psd=scenario.disturbance_psd,
            )
            yield Check(path, name, chosen, validation)
