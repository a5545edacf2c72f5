"""One local solve as a task for a worker, through families from coarse to fine."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.blas_threads import one_thread
from obsdesign.design.feasibility import initial_rows
from obsdesign.design.nlp.criterion_objective import matrix_objective_of
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.matrix_objective import AbstractMatrixObjective
from obsdesign.design.sqp.solver_state import WarmStart
from obsdesign.design.sqp.trust_region_sqp import TOLERANCE, StoppingCriteria
from obsdesign.design.tightening import SolveRound, SolveStart, solve_rounds
from obsdesign.paths.abstract import AbstractPath
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

# rounds of climbing again with tighter rows, and what is added in each for every shortfall: more where little has not helped
_ALLOWANCE_FACTORS = (1.1, 1.1, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
_COARSE_TOLERANCE = 1e-4  # tolerance where a finer climb follows


@dataclass(frozen=True, eq=False)
class LocalSolve:
    """A climb from inputs u (N, m) through families of the problem's path, coarse to fine; checked: also between the nodes.

    target: objective that it is abandoned below where it creeps, in the last of the families. ceiling: what no objective exceeds, where
    a climb ends.
    """

    problem: DesignProblem
    name: str
    u: np.ndarray
    families: tuple[AbstractPath, ...]
    checked: bool
    objective: AbstractMatrixObjective | None = None
    eigenvalue_floor: float = 0.0
    target: float = float("-inf")
    ceiling: float = float("inf")


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
    """Solve until the rows stay what they are and nothing falls short between the nodes."""
    target = local_solve.target if problem.path == local_solve.families[-1] else -np.inf
    rounds = solve_rounds(
        problem,
        matrix_objective_of(problem) if local_solve.objective is None else local_solve.objective,
        SolveStart(problem.path.fit(u, problem.grid), initial_rows(problem)),
        _ALLOWANCE_FACTORS,
        lambda solution, _: is_checked and solution.status.has_answer,
        stopping=StoppingCriteria(tolerance=TOLERANCE if is_checked else _COARSE_TOLERANCE, target=target, ceiling=local_solve.ceiling),
        eigenvalue_floor=local_solve.eigenvalue_floor,
    )
    iterations, last = 0, None
    for last in rounds:
        iterations += last.solution.iterations
        if not last.is_tightened:
            break
    if last is None:
        raise AssertionError("there is a round")
    return _local_solution(local_solve.name, last, iterations)


def _local_solution(name: str, last: SolveRound, iterations: int) -> LocalSolution:
    """Return where the last round ended; one after which there would have to be another has not come to an end."""
    solution, path = last.solution, last.checked.path
    status = Status.ITERATION_LIMIT if last.is_tightened else solution.status
    return LocalSolution(name, solution.p, path.u, path, solution.objective, status, iterations, solution.residual, solution.warm_start)
