"""The exact-penalty merit function: objective, price and largest violation of an iterate in one number."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.design.sqp.evaluation import AbstractDerivatives, AbstractEvaluation
from obsdesign.design.sqp.matrix_objective import AbstractMatrixObjective, evaluate_objective
from obsdesign.design.sqp.nonlinear_program import AnyProgram


@dataclass(frozen=True, eq=False)
class MeritScaling:
    """What merits are counted in: the unit of the objective, and what a violation of 1 costs in it."""

    unit: float
    penalty: float


@dataclass(frozen=True, eq=False)
class Iterate:
    """A point with its merit = (price - objective) / unit + penalty * largest violation; less is better."""

    evaluation: AbstractEvaluation
    floors: np.ndarray
    violation: float
    objective_value: float
    merit: float


@dataclass(frozen=True, eq=False)
class MeritFunction:
    """(price - objective) / unit + penalty * largest violation, of a program.

    eigenvalue_floor: lambda_min of every judged matrix is at least this; 0 = no such limit.
    """

    program: AnyProgram
    objective: AbstractMatrixObjective
    eigenvalue_floor: float = 0.0

    @property
    def width(self) -> np.ndarray:
        """Widths (q,) of the box."""
        return self.program.upper - self.program.lower

    def evaluate(self, p: np.ndarray, scaling: MeritScaling) -> Iterate:
        """Return the iterate of parameters p (q,), moved into their box."""
        return self.assess(self.program.evaluate(np.clip(p, self.program.lower, self.program.upper)), scaling)

    def assess(self, evaluation: AbstractEvaluation, scaling: MeritScaling) -> Iterate:
        """Return the iterate of an evaluation."""
        floors = self.floors(evaluation)
        return self.rescale(
            Iterate(
                evaluation,
                floors,
                largest_violation(evaluation.rows, floors),
                evaluate_objective(self.objective, evaluation.matrices),
                np.inf,
            ),
            scaling,
        )

    def rescale(self, iterate: Iterate, scaling: MeritScaling) -> Iterate:
        """Return an iterate in another scaling."""
        merit = (iterate.evaluation.price - iterate.objective_value) / scaling.unit + scaling.penalty * iterate.violation
        return replace(iterate, merit=float(merit) if np.isfinite(merit) else np.inf)

    def floors(self, evaluation: AbstractEvaluation) -> np.ndarray:
        """Matrices (f, n, n) that must be >= I."""
        return self._stack_floors(evaluation.floors, evaluation.matrices)

    def floor_derivatives(self, derivatives: AbstractDerivatives) -> np.ndarray:
        """Their derivatives (f, q, n, n)."""
        return self._stack_floors(derivatives.floors, derivatives.matrices)

    def _stack_floors(self, floors: np.ndarray, matrices: np.ndarray) -> np.ndarray:
        scaled = floors / self.program.floor_level
        return np.concatenate([scaled, matrices / self.eigenvalue_floor]) if self.eigenvalue_floor else scaled


def largest_violation(rows: np.ndarray, floors: np.ndarray) -> float:
    """Return by how much the worst of the rows (r,) falls short of 0, and of the floors (f, n, n) of 1."""
    lowest = 1 - float(np.linalg.eigvalsh(floors)[:, 0].min()) if len(floors) else 0.0
    return max(0.0, -float(rows.min(initial=0.0)), lowest)
