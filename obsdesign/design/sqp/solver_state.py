"""Everything that one iteration hands to the next, and where a solve begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from obsdesign.design.sqp.evaluation import AbstractDerivatives, AbstractEvaluation, Multipliers
from obsdesign.design.sqp.matrix_objective import initial_weights
from obsdesign.design.sqp.merit import Iterate, MeritFunction, MeritScaling

INITIAL_RADIUS = 0.3  # of the trust region, in widths of the box
INITIAL_PENALTY = 1.0  # of the largest violation, in units of the objective


@dataclass(frozen=True, eq=False)
class WarmStart:
    """Where a solve may begin beside its parameters: multipliers, penalty and radius of another one."""

    multipliers: Multipliers
    penalty: float = INITIAL_PENALTY
    radius: float = INITIAL_RADIUS


@dataclass(frozen=True, eq=False)
class SolverState:
    """Everything that one iteration hands to the next.

    at_bound (q,): parameters on their bounds; relaxations: times the penalty fell; derivatives: at the iterate; None: not
    known yet.
    """

    iterate: Iterate
    multipliers: Multipliers
    scaling: MeritScaling
    radius: float
    at_bound: np.ndarray
    relaxations: int = 0
    derivatives: AbstractDerivatives | None = None


def initial_state(merit_function: MeritFunction, p: np.ndarray, warm_start: WarmStart | None) -> SolverState:
    """Return the state at parameters p (q,), moved into their box, with the multipliers of a warm start where they fit."""
    evaluation = merit_function.program.evaluate(np.clip(p, merit_function.program.lower, merit_function.program.upper))
    scaling = MeritScaling(
        merit_function.objective.unit(evaluation.matrices), INITIAL_PENALTY if warm_start is None else warm_start.penalty
    )
    multipliers = _initial_multipliers(merit_function, evaluation, scaling)
    if warm_start is not None:
        multipliers = _reuse_multipliers(warm_start.multipliers, multipliers)
    radius = INITIAL_RADIUS if warm_start is None else warm_start.radius
    return SolverState(merit_function.assess(evaluation, scaling), multipliers, scaling, radius, np.zeros(len(p), dtype=bool))


def _initial_multipliers(merit_function: MeritFunction, evaluation: AbstractEvaluation, scaling: MeritScaling) -> Multipliers:
    """Multipliers before any model was solved: the objective's gradient, and 0 for limits."""
    weights = initial_weights(merit_function.objective, evaluation.matrices) / scaling.unit
    Z = np.nan_to_num(merit_function.objective.gradients(evaluation.matrices) * weights[:, None, None])
    return Multipliers(Z, np.zeros_like(evaluation.floors), np.zeros(len(evaluation.rows)), 1 / scaling.unit)


def _reuse_multipliers(previous: Multipliers, initial: Multipliers) -> Multipliers:
    """Another solve's multipliers, where they are as many."""
    pairs = ((previous.matrices, initial.matrices), (previous.floors, initial.floors), (previous.rows, initial.rows))
    matrices, floors, rows = (reused if reused.shape == fallback.shape else fallback for reused, fallback in pairs)
    return Multipliers(matrices, floors, rows, initial.price)
