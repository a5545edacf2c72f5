"""One climb as a task for a worker: rows, climb, check between the nodes, tighten, climb again."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from obsdesign.design.blas_threads import one_thread
from obsdesign.design.feasibility import rows_of, tightened
from obsdesign.design.nlp.program import Program
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.matrix_objective import AbstractAim, aim_of
from obsdesign.design.sqp.trust_region_sqp import TOLERANCE, Limits, Solution, Warm, climb
from obsdesign.dynamics.simulation import simulate
from obsdesign.paths.abstract import AbstractPath
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

# rounds of climbing again with tighter rows, and what is added in each for every shortfall: more where little has not helped
_FACTORS = (1.1, 1.1, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)
_COARSE = 1e-5  # tolerance where a finer climb follows


@dataclass(frozen=True, eq=False)
class Task:
    """A climb from inputs u (N, m) through families of the problem's path, coarse to fine; checked: also between the nodes."""

    problem: DesignProblem
    name: str
    u: np.ndarray
    families: tuple[AbstractPath, ...]
    checked: bool
    aim: AbstractAim | None = None
    least: float = 0.0


@dataclass(frozen=True, eq=False)
class Climbed:
    """Where a task ended: its parameters, inputs (N, m) and path, the program's objective, and how the climb ended."""

    name: str
    p: np.ndarray
    u: np.ndarray
    path: Trajectory
    objective: float
    status: Status
    iterations: int
    residual: float
    warm: Warm | None


def families_of(path: AbstractPath) -> tuple[AbstractPath, ...]:
    """Return families from the coarsest to the path's own, each of about four times as many parameters as the one before."""
    found = [path]
    while (coarser := found[-1].coarser()) is not None:
        found.append(coarser)
    kept = found[::2] if len(found) > 2 else found
    return tuple(reversed(kept))


def climbed(task: Task) -> Climbed:
    """Run a task in this process."""
    u, iterations, found = task.u, 0, None
    with one_thread():
        for family in task.families:
            problem = replace(task.problem, path=family)
            found = _settled(problem, task, u, task.checked and family is task.families[-1])
            u, iterations = found.u, iterations + found.iterations
    if found is None:
        raise ValueError("a task without families")
    return replace(found, iterations=iterations)


def _settled(problem: DesignProblem, task: Task, u: np.ndarray, checked: bool) -> Climbed:
    """Climb until the rows stay what they are and nothing falls short between the nodes."""
    aim = aim_of(problem) if task.aim is None else task.aim
    p, warm, done = problem.path.fit(u, problem.grid), None, 0
    rows = rows_of(problem)
    for round_, factor in enumerate(_FACTORS):
        solution = climb(Program(problem, rows), aim, p, warm, task.least, Limits(tolerance=TOLERANCE if checked else _COARSE))
        done += solution.iterations
        p, warm, path = solution.p, solution.warm, _flown(problem, solution.p)
        following = tightened(problem, path, rows, factor) if checked and solution.status.has_answer else None
        if following is None or round_ == len(_FACTORS) - 1:
            return _climbed(task.name, path, solution, done, solution.status if following is None else Status.ITERATION_LIMIT)
        warm, rows = replace(warm, multipliers=warm.multipliers.with_rows(len(rows.node), len(following.node))), following
    raise AssertionError("the last round returns")


def _flown(problem: DesignProblem, p: np.ndarray) -> Trajectory:
    grid = problem.grid
    u = np.array(problem.path.inputs(p, grid), dtype=float)  # pyright: ignore[reportArgumentType]  # serves both kinds
    return simulate(problem.system, problem.x0, u.reshape(grid.steps, -1), problem.step, tolerance=problem.tolerance)


def _climbed(name: str, path: Trajectory, solution: Solution, iterations: int, status: Status) -> Climbed:
    return Climbed(name, solution.p, path.u, path, solution.objective, status, iterations, solution.residual, solution.warm)
