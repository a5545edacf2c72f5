"""What a scenario asks of a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from obsdesign.costs._price_budget import Budget, Price
from obsdesign.design.floor import Floor
from obsdesign.design.problem import DesignProblem
from obsdesign.design.robust import Robust
from obsdesign.dynamics.simulation import simulate
from obsdesign.dynamics.system import System
from obsdesign.dynamics.text_system import TextSystem
from obsdesign.errors import InputError
from obsdesign.paths.piecewise_constant import PiecewiseConstant
from obsdesign.scenario.schema import Scenario
from obsdesign.trajectory import Trajectory


def start_of(scenario: Scenario) -> np.ndarray:
    """x(t_0) (n,). Raises InputError for a scenario without one, of which verdicts alone are asked."""
    if not scenario.start:
        raise InputError(
            f"{scenario.file}: there is no [start]: what its sensors can see is all that can be said of it (obsdesign analyse)"
        )
    return np.array([scenario.start[name] for name in scenario.state_names])


def scenario_paths(scenario: Scenario) -> dict[str, Trajectory]:
    """The paths that a scenario gives, by name: from the start, leg by leg."""
    step, names = scenario.time.step, [signal.name for signal in scenario.inputs]
    paths = {}
    for table in scenario.paths:
        legs = [np.tile([leg.inputs.get(name, 0.0) for name in names], (round(leg.seconds / step), 1)) for leg in table.legs]
        paths[table.name] = simulate(scenario.system, start_of(scenario), np.vstack(legs), step, tolerance=scenario.time.tolerance)
    return paths


def problem_along(scenario: Scenario, suite: tuple[str, ...], paths: Sequence[Trajectory], constraints: bool = True) -> DesignProblem:
    """Return what a scenario asks of given paths of one start and duration, for a suite; constraints: whether its own count."""
    names = scenario.system.model.input_names
    path, u = paths[0], np.vstack([path.u for path in paths])
    reach = zip(names, u.min(axis=0) - 1.0, u.max(axis=0) + 1.0, strict=True)
    return DesignProblem(
        system=system_with(scenario, suite),
        start=path.x[0],
        duration=path.step * path.steps,
        step=path.step,
        tolerance=path.tolerance,
        path=PiecewiseConstant(1),
        bounds={name: (float(low), float(high)) for name, low, high in reach},
        criterion=scenario.criterion,
        scale=[scenario.prior[name] for name in scenario.state_names],
        constraints=scenario.design.constraints if constraints else (),
        about=scenario.design.about,
    )


def system_with(scenario: Scenario, suite: tuple[str, ...]) -> System | TextSystem:
    """The scenario's system with some of its sensors; scales and biases of the others stay states."""
    system = scenario.system
    if set(suite) == set(scenario.sensor_names):
        return system
    return system.only(suite) if isinstance(system, TextSystem) else replace(system, suite=suite)


def problem_of(scenario: Scenario, suite: tuple[str, ...]) -> DesignProblem:
    """Return what a scenario asks of the path for a suite of sensors."""
    design, time = scenario.design, scenario.time
    robust, floor = design.robust, design.floor
    if design.path is None:
        raise InputError("the scenario has no design.path: its paths are given")
    return DesignProblem(
        system=system_with(scenario, suite),
        start=start_of(scenario),
        duration=time.duration if design.shortest is None else (design.shortest, time.duration),
        step=time.step,
        tolerance=time.tolerance,
        path=design.path,
        bounds=design.bounds,
        rates=design.rates,
        criterion=scenario.criterion,
        scale=[scenario.prior[name] for name in scenario.state_names],
        constraints=design.constraints,
        about=design.about,
        prices=tuple(Price(price.cost, price.per_unit) for price in design.prices),
        budgets=tuple(Budget(budget.cost, budget.at_most) for budget in design.budgets),
        floor=None if floor is None else Floor(floor.seconds, floor.value),
        robust=None if robust is None else Robust(scenario.prior_at_start, robust.samples, robust.worst, robust.seed),
    )
