"""What a study found, question by question."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from obsdesign.analysis.verdict import Verdict
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design
from obsdesign.design.violation import Violation
from obsdesign.design.weave import Weave
from obsdesign.display import AbstractDisplay, Summary, number
from obsdesign.estimation.validation import Validation
from obsdesign.information.blocks import Information
from obsdesign.information.contribution_shares import Contributions
from obsdesign.joint.result import AnyJoint
from obsdesign.planning.closed_loop import Flight
from obsdesign.scenario.path_names import DESIGNED, STRAIGHT
from obsdesign.scenario.schema import Scenario
from obsdesign.scenario.selection_tables import Question
from obsdesign.selection.pareto import Pareto
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.schedule import Schedule
from obsdesign.selection.sensor_loss import Loss
from obsdesign.study.rated_schedules import FOR, CheapestAnswer, FilterAnswer
from obsdesign.study.thinned_path import ThinnedPath
from obsdesign.trajectory import Trajectory

CHOSEN = "chosen"  # the name of the schedule, as STRAIGHT and DESIGNED are those of paths


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
    violations: tuple[Violation, ...]

    @property
    def feasible(self) -> bool:
        """Whether it breaks no limit."""
        return not self.violations

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.path.t[-1] - self.path.t[0])

    @property
    def blocks(self) -> np.ndarray:
        """Information (K, S, n, n) of each segment and sensor; amounts from below where errors are not independent."""
        return self.information.by_stretch(self.nodes[:-1])

    def information_under(self, chosen: np.ndarray) -> np.ndarray:
        """W (n, n) of all samples of a schedule (K, S) together."""
        return self.information.under(schedule_at_steps(chosen, self.nodes))


@dataclass(frozen=True, eq=False)
class RivalSchedule:
    """A naive schedule (K, S), its value, and the rules that it breaks."""

    name: str
    chosen: np.ndarray
    value: float
    breaks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Selection:
    """The schedule for a path, and what one would have done without thinking.

    schedule: for what all samples say of the start; filter: for what a filter knows along the way, with schedules under both questions,
    None where it was not looked for; cheapest: what keeps the requirements, None without any; question: which of them is asked, so that
    the study uses its schedule, or that for the filter where none keeps the requirements.
    exact: what the samples of the schedule for the start say together where errors are not independent, so that its value and bound, and
    those of the others, are about amounts from below; None where they are exact themselves.
    random_values: values of random schedules that keep the rules, sorted; losses: what losing each sensor costs, () for a single
    one; pareto: information against energy, where asked for.
    """

    schedule: Schedule
    rivals: tuple[RivalSchedule, ...]
    random_values: np.ndarray
    losses: tuple[Loss, ...] = ()
    pareto: Pareto | None = None
    exact: float | None = None
    question: Question = "start"
    filter: FilterAnswer | None = None
    cheapest: CheapestAnswer | None = None

    @property
    def answers(self) -> dict[Question, np.ndarray]:
        """The schedules (K, S) that there are, by the question that they answer."""
        cheapest, filter_answer = self.cheapest, self.filter
        schedules: dict[Question, Schedule | FilterSchedule] = {}
        if cheapest is not None:
            schedules["cheapest"] = cheapest.schedule
        if filter_answer is not None:
            schedules["filter"] = filter_answer.schedule
        schedules["start"] = self.schedule
        return {question: schedule.chosen for question, schedule in schedules.items() if schedule.status.has_answer}

    @property
    def question_in_use(self) -> Question:
        """The question whose schedule the study uses: the one that is asked; that of the filter where the cheapest one does not exist."""
        return "filter" if self.question == "cheapest" and "cheapest" not in self.answers else self.question

    @property
    def chosen(self) -> np.ndarray:
        """The schedule (K, S) that the study uses: what is on."""
        return self.answers.get(self.question_in_use, self.schedule.chosen)

    @property
    def others(self) -> dict[str, np.ndarray]:
        """Schedules (K, S) of questions that are not asked, by name."""
        return {FOR[question]: chosen for question, chosen in self.answers.items() if question != self.question_in_use}


@dataclass(frozen=True, eq=False)
class FilterCheck:
    """Filter runs on one path under one schedule."""

    path: str
    schedule: str
    chosen: np.ndarray
    validation: Validation


@dataclass(frozen=True, eq=False)
class Study(AbstractDisplay):
    """The answers to the questions of a scenario.

    Where paths are given, nothing is designed: designs is empty, and `others` are the studies of the other paths; analyses and checks are
    empty where only a schedule was asked for.
    """

    scenario: Scenario
    """What was asked."""
    seed: int
    """Seed of everything that was drawn."""
    analyses: tuple[Analysis, ...]
    """What each suite of sensors can see in each manoeuvre."""
    problems: tuple[DesignProblem, ...]
    """What is asked of a path, for each suite."""
    designs: tuple[Design, ...]
    """The paths found; designs[0] is for all sensors and is the one that selection and validation use."""
    weave: Weave | None
    """The path of alternating turns to compare with; None without one."""
    candidates: tuple[Candidate, ...]
    """All paths that are compared, each with its quality."""
    selection: Selection
    """The schedule, and what naive ones are worth."""
    checks: tuple[FilterCheck, ...]
    """Filter runs on paths under schedules."""
    seconds: Mapping[str, float]
    """Question -> wall time [s]."""
    flight: Flight | None = None
    """The flight, where it was asked for."""
    joint: AnyJoint | None = None
    """Path and schedule chosen together, where it was asked for."""
    about: str = DESIGNED
    """Name of the path that selection and validation are about."""
    others: tuple[Study, ...] = ()
    """Studies of the other given paths."""
    notes: tuple[str, ...] = ()
    """What is to be said about the paths, in words."""
    way_points: tuple[ThinnedPath, ...] = ()
    """What way points cost, for each file that the path was written to with some of its points."""

    def _summary(self) -> Summary:
        schedule = self.selection.schedule
        rows = [
            (f"sees ({', '.join(answer.sensors)}; {answer.manoeuvre})", f"{answer.verdict.dimension} of {len(answer.verdict.at)}")
            for answer in self.analyses[:5]
        ]
        rows += [
            (f"design for {' + '.join(suite)}", f"{number(design.value)}, {design.status.value}")
            for suite, design in zip(self.suites, self.designs, strict=False)
        ]
        rows.append(
            ("schedule for the start", f"{number(schedule.value)}, none is above {number(schedule.bound)}, {schedule.status.value}")
        )
        if self.selection.filter is not None:
            answer = self.selection.filter.schedule
            text = f"{number(answer.value)}, none is below {number(answer.bound)}, {answer.status.value}"
            rows.append(("schedule for the filter", text))
        if self.selection.cheapest is not None:
            cheapest = self.selection.cheapest.schedule
            text = f"{number(cheapest.value)}, none is below {number(cheapest.bound)}, {cheapest.status.value}"
            rows.append(("cheapest schedule", text if cheapest.status.has_answer else cheapest.notes[0]))
        rows += [(f"filter on {check.path}, {check.schedule}", check.validation.verdict) for check in self.checks]
        rows.append(("took", number(sum(self.seconds.values()), "s")))
        return Summary(f"study: {self.scenario.title}", tuple(rows))

    @property
    def suites(self) -> tuple[tuple[str, ...], ...]:
        """The sensor suites that are reported: all sensors first."""
        return suites_of(self.scenario)

    @property
    def baseline(self) -> str:
        """Name of the path that one would take without thinking; where paths are given, of the path itself."""
        return baseline_of(self.scenario) if self.designs else self.about

    @property
    def problem(self) -> DesignProblem:
        """What is asked of a path for all sensors."""
        return self.designs[0].problem if self.designs else self.problems[0]

    @property
    def main(self) -> Candidate:
        """The path that selection and validation are about: the one designed for all sensors, or a given one."""
        return self.candidate(self.about)

    @property
    def each(self) -> tuple[Study, ...]:
        """The studies of all paths that are given, this one first."""
        return (self, *self.others)

    def candidate(self, name: str) -> Candidate:
        """Return the candidate of that name."""
        return next(candidate for candidate in self.candidates if candidate.name == name)

    def check(self, path: str, schedule: str) -> FilterCheck:
        """Return the filter check of that path and schedule."""
        return next(check for check in self.checks if (check.path, check.schedule) == (path, schedule))


def suites_of(scenario: Scenario) -> tuple[tuple[str, ...], ...]:
    """All sensors, then the suites that the scenario names."""
    everything = scenario.sensor_names
    return (everything, *(suite for suite in scenario.design.suites if set(suite) != set(everything)))


def baseline_of(scenario: Scenario) -> str:
    """Name of the path that one would take without thinking: the first baseline, or the one of idle inputs."""
    return scenario.baselines[0].name if scenario.baselines else STRAIGHT


def schedule_at_steps(chosen: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Return (N, S): a schedule (K, S) at every step, its segments between nodes (K+1,)."""
    return np.repeat(chosen, np.diff(nodes), axis=0)
