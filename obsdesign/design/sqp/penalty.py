"""How the exact penalty and the unit of the objective follow the iterates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from obsdesign.design.sqp.evaluation import Multipliers
from obsdesign.design.sqp.local_model import FEASIBILITY_TOLERANCE, LocalModel, ModelSolution, slack_at_weight, solve_model
from obsdesign.design.sqp.merit import MeritFunction, MeritScaling
from obsdesign.design.sqp.solver_state import INITIAL_PENALTY, INITIAL_RADIUS, SolverState

MAX_PENALTY = 1e6  # where even this does not help, no feasible point is near
_MAX_RELAXATIONS = 6  # times the penalty may fall: it must not go up and down for ever


def steer_penalty(model: LocalModel, solution: ModelSolution, scaling: MeritScaling, radius: float) -> tuple[MeritScaling, ModelSolution]:
    """Raise the penalty where the objective is what keeps the model from being more feasible (Byrd, Nocedal, Waltz, 2008)."""
    while solution.qp_solution.slack > FEASIBILITY_TOLERANCE / 10 and scaling.penalty < MAX_PENALTY:
        if slack_at_weight(model, solution, scaling, radius, 0.1) > 0.8 * solution.qp_solution.slack:
            break
        raised_scaling = replace(scaling, penalty=10 * scaling.penalty)
        raised_solution = solve_model(model, raised_scaling, radius)
        if raised_solution is None:
            break
        scaling, solution = raised_scaling, raised_solution
    return scaling, solution


def raise_penalty(merit_function: MeritFunction, state: SolverState) -> SolverState:
    """Return the state with a higher penalty: where nothing better is near for this one, limits may still be met for another."""
    scaling = replace(state.scaling, penalty=10 * state.scaling.penalty)
    return replace(state, iterate=merit_function.rescale(state.iterate, scaling), scaling=scaling, radius=max(state.radius, INITIAL_RADIUS))


def update_scaling(merit_function: MeritFunction, state: SolverState) -> SolverState:
    """Return the state in a scaling that suits its iterate: a lower penalty once all limits hold, a unit near the objective."""
    scaling, relaxations = state.scaling, state.relaxations
    exact_penalty = max(INITIAL_PENALTY, 3 * _slack_price(merit_function, state.multipliers))
    if state.iterate.violation <= FEASIBILITY_TOLERANCE and relaxations < _MAX_RELAXATIONS and exact_penalty < scaling.penalty / 3:
        scaling, relaxations = replace(scaling, penalty=exact_penalty), relaxations + 1
    unit = merit_function.objective.unit(state.iterate.evaluation.matrices)
    if not scaling.unit / 3 <= unit <= 3 * scaling.unit:
        scaling = replace(scaling, unit=unit)
    if scaling is state.scaling:
        return state
    multipliers = state.multipliers.scale(state.scaling.unit / scaling.unit)
    return replace(
        state, iterate=merit_function.rescale(state.iterate, scaling), scaling=scaling, multipliers=multipliers, relaxations=relaxations
    )


def _slack_price(merit_function: MeritFunction, multipliers: Multipliers) -> float:
    """What all limits together would pay for slack: a penalty above it is exact."""
    floor_price = merit_function.program.floor_level * float(np.trace(multipliers.floors, axis1=1, axis2=2).sum())
    eigenvalue_price = (
        merit_function.eigenvalue_floor * float(np.trace(multipliers.matrices, axis1=1, axis2=2).sum())
        if merit_function.eigenvalue_floor
        else 0.0
    )
    return float(multipliers.rows.sum()) + floor_price + eigenvalue_price
