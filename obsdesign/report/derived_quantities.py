"""Numbers that the page needs and a study holds only between the lines: pure functions of the study."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.design.record import Design
from obsdesign.design.upper_bound import Cap
from obsdesign.estimation.validation import SETTLING_SHARE, active_steps
from obsdesign.information.posterior import posterior_information
from obsdesign.joint.result import AnyJoint
from obsdesign.round_off import standard_deviations
from obsdesign.selection.posterior.filter_schedule import FilterSchedule
from obsdesign.selection.schedule import Schedule, schedule_information
from obsdesign.signals import Signal
from obsdesign.study.rated_schedules import FOR
from obsdesign.study.record import CHOSEN, Analysis, FilterCheck, Quality, Study, schedule_at_steps

PATH_FIRST, SENSORS_FIRST, TOGETHER = "path first", "sensors first", "together"


@dataclass(frozen=True)
class ErrorChange:
    """The final RMSE of one state: on the designed path with the chosen schedule, and on the baseline."""

    signal: Signal
    error: float
    baseline_error: float

    @property
    def is_better(self) -> bool:
        """Whether the error is smaller by a fifth or more."""
        return self.error <= 0.8 * self.baseline_error

    @property
    def is_worse(self) -> bool:
        """Whether the error is larger by a fifth or more."""
        return self.error >= 1.2 * self.baseline_error


def joint_answers(joint: AnyJoint) -> dict[str, tuple[Design, Schedule | FilterSchedule, float]]:
    """The three answers of a codesign: a path, a schedule, and what they are worth together."""
    return {
        PATH_FIRST: (joint.path_first.design, joint.path_first.schedule, joint.path_first.value),
        SENSORS_FIRST: (joint.sensors_first.design, joint.sensors_first.schedule, joint.sensors_first.value),
        TOGETHER: (joint.design, joint.schedule, joint.value),
    }


def filter_cost(study: Study, value: float) -> float:
    """Return the filter's cost that a value of path and schedule stands for, chosen together for a filter: -value, or 1 / value."""
    return 1 / value if study.scenario.filter_criterion.is_smallest_eigenvalue else -value


def states_of(study: Study) -> tuple[Signal, ...]:
    """The n states."""
    return study.scenario.states


def sensors_in_words(study: Study, sensors: tuple[str, ...]) -> str:
    """Return what a suite is called: all sensors, gps alone, gps + range."""
    if set(sensors) == set(study.scenario.sensor_names):
        return "all sensors" if len(sensors) > 1 else "the sensor"
    return " + ".join(sensors) + (" alone" if len(sensors) == 1 else "")


def numerical_zero(eigenvalues: np.ndarray) -> float:
    """Return n eps lambda_max: what an eigenvalue (n,) must exceed to differ from 0 in double precision."""
    return float(len(eigenvalues) * np.finfo(float).eps * max(eigenvalues[-1], 0.0))


def clean_eigenvalues(quality: Quality) -> np.ndarray:
    """Eigenvalues (n,) of a path and a suite, those that cannot be told from 0 set to 0."""
    return without_zeros(quality.eigenvalues)


def without_zeros(eigenvalues: np.ndarray) -> np.ndarray:
    """Eigenvalues (n,), ascending, those that cannot be told from 0 set to 0."""
    return np.where(eigenvalues <= numerical_zero(eigenvalues), 0.0, eigenvalues)


def value_of(study: Study, quality: Quality) -> float:
    """Return the criterion, as if eigenvalues that are round-off were 0."""
    if judged_by_eigenvalue(study):
        return quality.value if quality.value > numerical_zero(quality.eigenvalues) else 0.0
    criterion, eigenvalues = study.scenario.criterion, clean_eigenvalues(quality)
    if criterion.knowledge is not None or study.scenario.design.about:
        return quality.value
    return quality.value if np.isfinite(criterion.value(np.diag(eigenvalues))) else float("-inf")


def judged_by_eigenvalue(study: Study) -> bool:
    """Whether the criterion of the design is the smallest eigenvalue of what the samples say."""
    criterion = study.scenario.criterion
    return criterion.is_smallest_eigenvalue and criterion.knowledge is None


def is_about_all_states(study: Study) -> bool:
    """Whether the criterion is about every state, so that a smallest eigenvalue of S W S is what it counts."""
    return not study.scenario.design.about


def start_schedule_name(study: Study) -> str:
    """What the schedule for the start is called: chosen, where the start is what is asked."""
    return CHOSEN if study.selection.question_in_use == "start" else FOR["start"]


def segment_nodes(study: Study) -> np.ndarray:
    """Times (K+1,) [s] between which the designed path has its K segments."""
    return study.main.path.t[study.main.nodes]


def zero_round_off(study: Study, value: float) -> float:
    """Return the value of a schedule, 0 for a smallest eigenvalue that cannot be told from 0."""
    if not study.scenario.schedule_criterion.is_smallest_eigenvalue:
        return value
    total = np.linalg.eigvalsh(study.problem.scaled(study.main.information.total))
    return 0.0 if 0 < abs(value) <= 10 * numerical_zero(total) else value


def drawing_suffix(study: Study) -> str:
    """Return what tells the drawings of this path from those of the other given paths."""
    index = [candidate.name for candidate in study.candidates].index(study.about)
    return "" if study.designs or index == 0 else f"-{index + 1}"


def cap_for(study: Study, sensors: tuple[str, ...]) -> Cap | None:
    """Return the upper bound on the criterion of every path for a suite, where there is one."""
    if not study.designs:
        return None
    return study.designs[study.suites.index(sensors)].cap


def outside_share(study: Study, quality: Quality, cap: Cap) -> float:
    """Return how much of the weakest direction (its squares) lies in states outside the block of the cap."""
    inside = [study.scenario.state_names.index(name) for name in cap.states]
    return float(1 - np.sum(quality.weakest[inside] ** 2))


def segment_shares(study: Study) -> np.ndarray:
    """v' W_k v / lambda_min (K,): what each segment of the designed path adds in its weakest direction v, all sensors on."""
    return study.main.contributions.weakest_shares.sum(axis=1)


def position_covariances(study: Study) -> np.ndarray:
    """Return (N+1, 2, 2) [m^2]: the posterior bound on x, y along the designed path with the chosen schedule."""
    scenario, path = study.scenario, study.main.path
    active = active_steps(scenario.system, path, schedule_at_steps(study.selection.chosen, study.main.nodes))
    prior, psd = scenario.prior_at_start, scenario.disturbance_psd
    J = posterior_information(scenario.system, path, prior, psd, active=active, input_psd=scenario.input_psd)
    columns = study.problem.position
    return np.linalg.inv(J)[np.ix_(range(len(J)), columns, columns)]


def hidden_states(study: Study, check: FilterCheck) -> tuple[str, ...]:
    """Names of the states that the samples of a schedule along a path do not determine, without prior."""
    candidate = study.candidate(check.path)
    exact = candidate.information.samples is not None
    std = standard_deviations(candidate.information_under(check.chosen) if exact else schedule_information(candidate.blocks, check.chosen))
    return tuple(name for name, deviation in zip(study.scenario.state_names, std, strict=True) if np.isinf(deviation))


def on_times(study: Study, chosen: np.ndarray) -> dict[str, float]:
    """Seconds for which a schedule (K, S) has each sensor on, longest first, those never on left out."""
    seconds = np.diff(segment_nodes(study)) @ chosen
    order = np.argsort(-seconds, kind="stable")
    return {study.scenario.sensor_names[i]: float(seconds[i]) for i in order if seconds[i] > 0}


def final_changes(study: Study) -> tuple[ErrorChange, ...]:
    """Compare the final RMSE per state on the designed path, chosen schedule, with the baseline's."""
    ours, theirs = study.check(study.about, CHOSEN).validation.rmse[-1], baseline(study).validation.rmse[-1]
    return tuple(ErrorChange(signal, float(a), float(b)) for signal, a, b in zip(states_of(study), ours, theirs, strict=True))


def baseline(study: Study) -> FilterCheck:
    """The filter runs on the path that one would take without thinking, with the naive schedule."""
    return next(check for check in study.checks if check.path == study.baseline and check.schedule == study.selection.rivals[0].name)


def settling_time(study: Study) -> float:
    """Time [s] after which consistency is judged."""
    return SETTLING_SHARE * study.main.duration


def nees_peak(check: FilterCheck) -> tuple[float, float]:
    """Return (highest NEES, when [s])."""
    worst = int(np.argmax(check.validation.nees))
    return float(check.validation.nees[worst]), float(check.validation.t[worst])


def unobservable_analyses(study: Study, sensors: tuple[str, ...]) -> tuple[Analysis, ...]:
    """The manoeuvres in which a suite does not see the whole state."""
    return tuple(analysis for analysis in study.analyses if set(analysis.sensors) == set(sensors) and not analysis.verdict.observable)
