"""One climb as a task for a worker: rows, climb, check between the nodes, tighten, climb again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.design.blas_threads import one_thread
from obsdesign.design.feasibility import initial_rows, tighten
from obsdesign.design.nlp.criterion_objective import matrix_objective_of
from obsdesign.design.nlp.program import Program
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.matrix_objective import AbstractMatrixObjective
from obsdesign.design.sqp.solver_state import WarmStart
from obsdesign.design.sqp.trust_region_sqp import TOLERANCE, Solution, StoppingCriteria, solve
from obsdesign.paths.abstract import AbstractPath
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

# rounds of climbing again with tighter rows, and what is added in each for every shortfall: more where little has not helped
_ALLOWANCE_FACTORS = (1.1, 1.1, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
_COARSE_TOLERANCE = 1e-5  # tolerance where a finer climb follows


@dataclass(frozen=True, eq=False)
class LocalSolve:
    """A climb from inputs u (N, m) through families of the problem's path, coarse to fine; checked: also between the nodes."""

    problem: DesignProblem
    name: str
    u: np.ndarray
    families: tuple[AbstractPath, ...]
    checked: bool
    objective: AbstractMatrixObjective | None = None
    eigenvalue_floor: float = 0.0


@dataclass(frozen=True, eq=False)
class LocalSolution:
    """Where a task ended: its parameters, inputs (N, m) and path, the program's objective, and how the climb ended."""

    name: str
    p: np.ndarray
    u: np.ndarray
    path: Trajectory
    objective: float
    status: Status
    iterations: int
    residual: float
    warm_start: WarmStart | None


def families_of(path: AbstractPath) -> tuple[AbstractPath, ...]:
    """Return families from the coarsest to the path's own, each of about four times as many parameters as the one before."""
    families = [path]
    while (coarser := families[-1].coarser()) is not None:
        families.append(coarser)
    selected = families[::2] if len(families) > 2 else families
    return tuple(reversed(selected))


def solve_locally(local_solve: LocalSolve) -> LocalSolution:
    """Run a task in this process."""
    u, iterations, solution = local_solve.u, 0, None
    with one_thread():
        for family in local_solve.families:
            problem = replace(local_solve.problem, path=family)
            solution = _solve_and_tighten(problem, local_solve, u, local_solve.checked and family is local_solve.families[-1])
            u, iterations = solution.u, iterations + solution.iterations
    if solution is None:
        raise ValueError("a task without families")
    return replace(solution, iterations=iterations)


def _solve_and_tighten(problem: DesignProblem, local_solve: LocalSolve, u: np.ndarray, is_checked: bool) -> LocalSolution:
    """Climb until the rows stay what they are and nothing falls short between the nodes."""
    objective = matrix_objective_of(problem) if local_solve.objective is None else local_solve.objective
    p, warm_start, iterations = problem.path.fit(u, problem.grid), None, 0
    rows = initial_rows(problem)
    for round_, factor in enumerate(_ALLOWANCE_FACTORS):
        solution = solve(
            Program(problem, rows),
            objective,
            p,
            warm_start,
            local_solve.eigenvalue_floor,
            StoppingCriteria(tolerance=TOLERANCE if is_checked else _COARSE_TOLERANCE),
        )
        iterations += solution.iterations
        p, warm_start, path = solution.p, solution.warm_start, problem.path_of(solution.p)
        tighter_rows = tighten(problem, path, rows, factor) if is_checked and solution.status.has_answer else None
        if tighter_rows is None or round_ == len(_ALLOWANCE_FACTORS) - 1:
            return _local_solution(
                local_solve.name, path, solution, iterations, solution.status if tighter_rows is None else Status.ITERATION_LIMIT
            )
        warm_start, rows = (
            replace(warm_start, multipliers=warm_start.multipliers.with_rows(len(rows.node), len(tighter_rows.node))),
            tighter_rows,
        )
    raise AssertionError("the last round returns")


def _local_solution(name: str, path: Trajectory, solution: Solution, iterations: int, status: Status) -> LocalSolution:
    return LocalSolution(name, solution.p, path.u, path, solution.objective, status, iterations, solution.residual, solution.warm_start)
