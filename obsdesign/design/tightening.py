"""Solve, look between the nodes, ask for what fell short there, solve again: for a design and for a plan."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from obsdesign.design.checked_path import CheckedPath
from obsdesign.design.feasibility import tighten
from obsdesign.design.nlp.evaluation import ConstraintRows
from obsdesign.design.nlp.program import Program
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.matrix_objective import AbstractMatrixObjective
from obsdesign.design.sqp.solver_state import WarmStart
from obsdesign.design.sqp.trust_region_sqp import Solution, StoppingCriteria, solve


@dataclass(frozen=True, eq=False)
class SolveStart:
    """Where a solve begins."""

    p: np.ndarray
    """Parameters (q,) of the path's family."""
    rows: ConstraintRows
    """Which margins are asked for when."""
    warm_start: WarmStart | None = None
    """Multipliers, penalty and radius of an earlier solve; None = without."""


@dataclass(frozen=True, eq=False)
class SolveRound:
    """One solve, the path that it came to, and where the next one begins."""

    solution: Solution
    checked: CheckedPath
    next_start: SolveStart
    is_tightened: bool
    """Whether the next one asks for more, as something fell short between the nodes."""


def solve_rounds(
    problem: DesignProblem,
    objective: AbstractMatrixObjective,
    start: SolveStart,
    factors: Iterable[float],
    is_worth_tightening: Callable[[Solution, CheckedPath], bool],
    *,
    stopping: StoppingCriteria | None = None,
    eigenvalue_floor: float = 0.0,
) -> Iterator[SolveRound]:
    """Yield one solve after the other, each from where the last one stopped, with rows for what its path fell short of.

    The caller takes as many as it wants, before each of which it may look at the clock.

    Arguments:
        problem: what is solved.
        objective: what is maximised, less prices.
        start: where the first solve begins.
        factors: for every round, by how many times a shortfall what is asked for already is raised (`tighten`).
        is_worth_tightening: whether a solution is near enough to its rows for what they leave out to be asked for.
        stopping: when each solve ends.
        eigenvalue_floor: as in `trust_region_sqp.solve`.
    """
    for factor in factors:
        solution = solve(Program(problem, start.rows), objective, start.p, start.warm_start, eigenvalue_floor, stopping)
        checked = CheckedPath(problem, problem.path_of(solution.p))
        rows = tighten(problem, checked.path, start.rows, factor) if is_worth_tightening(solution, checked) else None
        start = _next_start(solution, start.rows, rows)
        yield SolveRound(solution, checked, start, rows is not None)


def _next_start(solution: Solution, rows: ConstraintRows, tighter_rows: ConstraintRows | None) -> SolveStart:
    """Go on from a solution, new rows counting for nothing yet."""
    if tighter_rows is None:
        return SolveStart(solution.p, rows, solution.warm_start)
    multipliers = solution.warm_start.multipliers.with_rows(len(rows.node), len(tighter_rows.node))
    return SolveStart(solution.p, tighter_rows, replace(solution.warm_start, multipliers=multipliers))
