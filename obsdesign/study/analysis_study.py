"""What every suite of sensors sees, under every class of disturbances, in every manoeuvre: no path, no filter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np

from obsdesign.analysis.explanation import Reason, explain
from obsdesign.analysis.mending import Remedies, remedies
from obsdesign.analysis.polynomial_inputs import Polynomial
from obsdesign.analysis.query import Disturbance, observability_of
from obsdesign.arguments import validate_arguments
from obsdesign.progress import Progress
from obsdesign.scenario.schema import Scenario
from obsdesign.scenario.tables import Manoeuvre
from obsdesign.study.analysis_along import AlongPath
from obsdesign.study.problem import system_with
from obsdesign.study.record import Analysis

_FEW_SENSORS = 5  # of which every subset is looked at
_AT_ONCE, _FEW_UNUSED = 2, 10  # remedies that are tried at once, where so few sensors are offered


@dataclass(frozen=True, eq=False)
class HiddenCase:
    """A case in which all sensors together, or a largest suite that was asked about, do not see the state: why, and what would mend it."""

    analysis: Analysis
    reasons: tuple[Reason, ...]
    remedies: Remedies


@dataclass(frozen=True, eq=False)
class AnalysisStudy:
    """The verdicts of a scenario: sensors within manoeuvres within disturbances; at (n,): the state asked about, None = generic.

    along: what the motion along a path or a log hides, None where there is none; hidden: the cases in which all sensors
    together, or the largest suites that were asked about, do not see the state; none where states are known at the start.
    """

    scenario: Scenario
    seed: int
    at: np.ndarray | None
    analyses: tuple[Analysis, ...]
    along: AlongPath | None = None
    hidden: tuple[HiddenCase, ...] = ()

    @property
    def manoeuvres(self) -> tuple[str, ...]:
        """Names of the ways of moving."""
        return tuple(dict.fromkeys(analysis.manoeuvre for analysis in self.analyses))

    @property
    def disturbances(self) -> tuple[str, ...]:
        """The classes of unknown inputs, in words."""
        return tuple(dict.fromkeys(analysis.verdict.disturbance for analysis in self.analyses))

    @property
    def of_all_sensors(self) -> tuple[Analysis, ...]:
        """The verdicts about all sensors together, or, where that was not asked, about the largest suites."""
        largest = max(len(analysis.sensors) for analysis in self.analyses)
        return tuple(analysis for analysis in self.analyses if len(analysis.sensors) == largest)


@validate_arguments
def analyse_scenario(scenario: Scenario, seed: int | None = None, progress: Progress | None = None) -> AnalysisStudy:
    """Return the verdict of every case of a scenario: see [analysis] and [[manoeuvres]].

    Arguments:
        scenario: what is asked; its [start], [time] and [design] are not needed.
        seed: of the generic points; None = the scenario's.
        progress: is called with how far it is; None = nobody is told.
    Raises InputError for a point outside a function's domain.
    """
    seed, at = scenario.seed if seed is None else seed, point_of(scenario)
    cases, analyses = list(_cases(scenario)), list[Analysis]()
    for done, case in enumerate(cases):
        if progress is not None:
            progress(f"{done} of {len(cases)} cases")
        model, settings = scenario.system.model.only(case.sensors), scenario.analysis
        verdict = observability_of(
            model, at, case.manoeuvre.held, case.disturbance, settings.known_inputs, seed, known_at_start=settings.known_at_start
        )
        analyses.append(Analysis(case.manoeuvre.name, case.sensors, verdict))
    study = AnalysisStudy(scenario, seed, at, tuple(analyses))
    return replace(study, hidden=tuple(_hidden_cases(study, cases, progress)))


def point_of(scenario: Scenario) -> np.ndarray | None:
    """Return the state (n,) that is asked about, None = a generic one."""
    point = scenario.analysis.point
    if point == "generic" or (point == "start" and not scenario.start):
        return None
    values = scenario.start if point == "start" else point
    return np.array([values[name] for name in scenario.state_names])


def subsets_of(scenario: Scenario) -> tuple[tuple[str, ...], ...]:
    """Return the suites that are looked at: those of the file, or every one; of many sensors each alone, all but one, and all."""
    names, given = scenario.sensor_names, scenario.analysis.subsets
    sizes = range(1, len(names) + 1) if len(names) <= _FEW_SENSORS else sorted({1, len(names) - 1, len(names)})
    return given or tuple(subset for size in sizes for subset in combinations(names, size))


def _hidden_cases(study: AnalysisStudy, cases: Sequence[_Case], progress: Progress | None) -> Iterator[HiddenCase]:
    """Yield the cases of the largest suites that hide something."""
    scenario, largest = study.scenario, study.of_all_sensors
    if scenario.analysis.known_at_start:
        return
    for case, analysis in zip(cases, study.analyses, strict=True):
        if analysis not in largest or analysis.verdict.observable:
            continue
        if progress is not None:
            progress(f"Why, and what would mend it: {case_name(study, analysis)}")
        question = (study.at, case.manoeuvre.held, case.disturbance, scenario.analysis.known_inputs, study.seed)
        reasons = explain(system_with(scenario, case.sensors), *question).reasons
        at_once = _AT_ONCE if len(scenario.sensor_names) - len(case.sensors) <= _FEW_UNUSED else 1
        yield HiddenCase(analysis, reasons, remedies(scenario.system, *question, sensors=case.sensors, at_once=at_once))


@dataclass(frozen=True)
class _Case:
    """One verdict that is asked for."""

    disturbance: Disturbance
    manoeuvre: Manoeuvre
    sensors: tuple[str, ...]


def _cases(scenario: Scenario) -> Iterator[_Case]:
    has_unknown = bool(scenario.system.model.unknown_inputs)
    for given in scenario.analysis.disturbances if has_unknown else ("arbitrary",):
        for manoeuvre in scenario.manoeuvres:
            yield from (_Case(_disturbance(given), manoeuvre, sensors) for sensors in subsets_of(scenario))


def _disturbance(given: Literal["arbitrary"] | int) -> Disturbance:
    return Polynomial(given) if isinstance(given, int) else given


def suite_name(study: AnalysisStudy, sensors: tuple[str, ...]) -> str:
    """Return what a suite is called."""
    if set(sensors) != set(study.scenario.sensor_names):
        return " + ".join(sensors)
    return "all sensors together" if len(sensors) > 1 else "the sensor"


def cases_apart(study: AnalysisStudy) -> tuple[Analysis, ...]:
    """Return the verdicts, each with the name of its case for its manoeuvre."""
    return tuple(replace(analysis, manoeuvre=case_name(study, analysis)) for analysis in study.analyses)


def case_name(study: AnalysisStudy, analysis: Analysis) -> str:
    """Return what a case is called: its manoeuvre, and its disturbance where there are several classes."""
    disturbance = _DISTURBANCES.get(analysis.verdict.disturbance, f"disturbance {analysis.verdict.disturbance}")
    names = (analysis.manoeuvre, len(study.manoeuvres)), (disturbance, len(study.disturbances))
    return ", ".join(name for name, count in names if count > 1) or analysis.manoeuvre


_DISTURBANCES = {"arbitrary": "any disturbance", "polynomial of degree 0": "constant disturbance"}
