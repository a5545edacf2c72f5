"""Answering the questions of a scenario."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from itertools import combinations
from time import perf_counter

import numpy as np

from obsdesign.analysis.question import observability_of
from obsdesign.design.problem import DesignProblem
from obsdesign.design.shaping import design_trajectory
from obsdesign.flight import Flight, fly
from obsdesign.scenario.schema import DESIGNED, Scenario
from obsdesign.selection.naive import always, at_random, round_robin
from obsdesign.selection.selecting import select_sensors
from obsdesign.selection.schedule import schedule_value
from obsdesign.study.candidates import candidates_of
from obsdesign.study.problem import problem_of, start_of
from obsdesign.study.record import CHOSEN, Analysis, Candidate, Check, Rival, Selection, Study, baseline_of, every_step, suites_of
from obsdesign.validation import validate

RANDOM_SCHEDULES = 1000
Progress = Callable[[str], None]


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
    weave, candidates = candidates_of(scenario, designs)
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
