"""What a scenario asks of a path."""

from __future__ import annotations

import numpy as np

from obsdesign.costs._terms import Budget, Price
from obsdesign.design.problem import DesignProblem, Floor, Robust
from obsdesign.scenario.schema import Scenario
from obsdesign.system import System


def start_of(scenario: Scenario) -> np.ndarray:
    """x(t_0) (n,)."""
    return np.array([scenario.start[name] for name in scenario.state_names])


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
