"""Judging a path that is given to an autopilot as way points: flown again, seen again, filtered again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.design.feasibility import violations
from obsdesign.design.problem_checks import position_of
from obsdesign.estimation.validation import active_steps
from obsdesign.information.gramian import variational_gramian
from obsdesign.information.posterior import posterior_information
from obsdesign.scenario.schema import Scenario
from obsdesign.study.problem import problem_along
from obsdesign.study.thinned_path import Autopilot, ThinnedPath, points_every, polyline_distances, thin
from obsdesign.study.way_point_flight import fly_way_points
from obsdesign.trajectory import Trajectory


@dataclass(frozen=True)
class Thinning:
    """Which points of a path become way points: those that keep it within a tolerance [m], or one every so many seconds."""

    tolerance: float | None = 2.0
    every: float | None = None


def way_points_of(scenario: Scenario, path: Trajectory, thinning: Thinning, always: tuple[int, ...] = ()) -> np.ndarray:
    """Return the indices (M,) of the nodes of a path that are its way points; always: those that stay."""
    if thinning.every is not None:
        return points_every(path.t, thinning.every, always)
    columns = list(position_of(scenario.state_names))
    return np.arange(len(path.t)) if thinning.tolerance is None else thin(path.x[:, columns], thinning.tolerance, always)


def judge_way_points(
    scenario: Scenario, path: Trajectory, chosen: np.ndarray, points: np.ndarray, thinning: Thinning, autopilot: Autopilot
) -> ThinnedPath:
    """Return what flying through the way points alone costs: information and the filter's deviations along the path and the flight.

    chosen (K, S): the schedule, by time; a flight that lasts longer keeps the last segment's sensors.
    Raises InputError for a vehicle that the guidance cannot steer.
    """
    system, columns = scenario.system, list(position_of(scenario.state_names))
    bounds = scenario.design.bounds.get("turn_rate", (-np.inf, np.inf))
    flown, reached = fly_way_points(system, path, points, bounds, autopilot)
    kept_limits = {violation.what for violation in _violations(scenario, path)}
    broken = tuple(str(violation) for violation in _violations(scenario, flown) if violation.what not in kept_limits)
    return ThinnedPath(
        points=tuple(points.tolist()),
        of=len(path.t),
        tolerance=thinning.tolerance if thinning.every is None else None,
        every=thinning.every,
        autopilot=autopilot,
        deviation=float(polyline_distances(flown.x[:, columns], path.x[:, columns]).max()),
        durations=(float(path.t[-1] - path.t[0]), float(flown.t[-1] - flown.t[0])),
        reached=reached,
        smallest_eigenvalue=(_smallest_eigenvalue(scenario, path), _smallest_eigenvalue(scenario, flown)),
        states=scenario.state_names,
        units=tuple(signal.unit for signal in scenario.states),
        std=np.stack([_final_deviations(scenario, each, chosen) for each in (path, flown)]),
        broken=broken,
    )


def _violations(scenario: Scenario, path: Trajectory):  # noqa: ANN202  # as `violations` returns them
    return violations(problem_along(scenario, scenario.sensor_names, (path,)), path)


def _smallest_eigenvalue(scenario: Scenario, path: Trajectory) -> float:
    """lambda_min of S W S, all sensors on, S the prior's standard deviations."""
    scale = np.array([scenario.prior[name] for name in scenario.state_names])
    return float(variational_gramian(scenario.system, path).visibility.principal_axes(scale)[0][0])


def _final_deviations(scenario: Scenario, path: Trajectory, chosen: np.ndarray) -> np.ndarray:
    """Standard deviations (n,) of what a filter knows at the end, with the sensors of a schedule (K, S)."""
    steps = round(scenario.time.segment / path.step)
    rows = chosen[np.minimum(np.arange(path.steps) // steps, len(chosen) - 1)]
    active = active_steps(scenario.system, path, rows)
    prior, psd = scenario.prior_at_start, scenario.disturbance_psd
    J = posterior_information(scenario.system, path, prior, psd, active=active, input_psd=scenario.input_psd)
    return np.sqrt(np.diag(np.linalg.inv(J[-1])))
