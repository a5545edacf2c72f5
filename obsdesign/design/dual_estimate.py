"""How much better might another path be: the dual question, asked from several starts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from itertools import islice

import numpy as np

from obsdesign.design.best_design import choose_best
from obsdesign.design.feasibility import is_feasible
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import LocalSolution, LocalSolve, families_of, solve_locally
from obsdesign.design.nlp.criterion_objective import matrix_objective_of
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design, Evidence
from obsdesign.design.sqp.conic_qp import Cone, ConicQP, minimise
from obsdesign.design.sqp.matrix_objective import LinearObjective
from obsdesign.progress import StageReport

_ROUNDS, _RANDOM_PATHS = 6, 40  # of a new Z; paths that are looked at without a climb
_TOLERANCE = 1e-4  # remaining difference, relative, at which it stops


def evidence_for(design: Design, starts: int, seed: int, executor: Executor | None, report: StageReport) -> Design:
    """Return the design with its evidence; a better path that is met on the way takes its place.

    For every Z >= 0 of trace 1, max over paths of <Z, S W S> is an upper bound on every lambda_min(S W S). It is climbed to from
    `starts` starts, which is no proof; the paths found are columns of a small program for the next Z (column generation).
    Only for the smallest eigenvalue along one path, without prices.
    """
    problem = design.problem
    if not problem.criterion.is_smallest_eigenvalue or problem.robust is not None or problem.prices or problem.criterion.knowledge:
        return design
    if design.trajectory is None:
        return design
    paths = [(design.trajectory.u, problem.matrix(design.trajectory)), *_random_paths(problem, seed)]
    duals, climbs, best_design = [], 0, design
    for _ in range(_ROUNDS):
        Z = _mixture_dual(problem, [W for _, W in paths])
        duals.append(Z)
        promising = sorted(paths, key=lambda pair: -float(np.sum(Z * pair[1])))[:starts]  # used at once
        solved = _maximise_dual(problem, Z, [u for u, _ in promising], executor)
        solutions = list(report.count(solved, starts * _ROUNDS, "climbs at most done", climbs))
        climbs += len(solutions)
        feasible = [solution for solution in solutions if solution.status.has_answer and is_feasible(problem, solution.path)]
        paths += [(solution.u, problem.matrix(solution.path)) for solution in feasible]
        best_design = _improve_from_best(best_design, feasible)
        if _estimate(duals, paths)[0] <= best_design.value * (1 + _TOLERANCE):
            break
    estimate, best_dual = _estimate(duals, paths)
    remaining = float(max(0.0, 1 - best_design.value / estimate))
    words = (
        f"{climbs} climbs along <Z, S W S> for {len(duals)} matrices Z met no path above {estimate:.6g} for the best of them: as far as "
        f"they tell, no path is better by more than {remaining:.2%}. Evidence, not proof."
    )
    return replace(best_design, evidence=Evidence(estimate, remaining, best_dual, climbs, words))


_PathInformation = tuple[np.ndarray, np.ndarray]  # inputs of a path, and its S W S


def _random_paths(problem: DesignProblem, seed: int) -> list[_PathInformation]:
    """Paths of the shaped and random starts that meet all limits."""
    paths = []
    for _, u in islice(start_inputs(problem, seed + 1), _RANDOM_PATHS):
        p = problem.path.fit(u, problem.grid)
        path = problem.path_of(p)
        if is_feasible(problem, path):
            paths.append((path.u, problem.matrix(path)))
    return paths


def _estimate(dual_matrices: Sequence[np.ndarray], paths: Sequence[_PathInformation]) -> tuple[float, np.ndarray]:
    """The least, over all Z tried, of the largest <Z, S W S> of any path seen, and that Z."""
    largest = [max(float(np.sum(Z * W)) for _, W in paths) for Z in dual_matrices]
    best = int(np.argmin(largest))
    return largest[best], dual_matrices[best]


def _mixture_dual(problem: DesignProblem, columns: Sequence[np.ndarray]) -> np.ndarray:
    """Z >= 0, trace 1 over the judged states, that makes the largest <Z, W> of the columns least.

    It is the multiplier of the best mixture: max t with sum_j a_j W_j - t E >= 0, a >= 0, sum a = 1.
    """
    n, size = len(problem.x0), float(np.mean([np.trace(W) for W in columns])) / len(problem.x0)
    E = np.zeros((n, n))
    E[problem.about_indices, problem.about_indices] = 1.0
    last, others = columns[-1] / size, np.array([W / size - columns[-1] / size for W in columns[:-1]]).reshape(-1, n, n)
    count = len(others)
    mixture = ConicQP(
        B=1e-9 * np.eye(count),
        g=np.zeros(count),
        weights=np.ones(1),
        penalty=1e3,
        lower=np.zeros(count),
        upper=np.ones(count),
        cones=(Cone(last, others, E, 0, 0.0),),
        rows=np.ones(1),
        jacobian=-np.ones((1, count)),
        epigraph_rows=np.zeros(0),
        epigraph_jacobian=np.zeros((0, count)),
    )
    solution = minimise(mixture, 1e-9)
    Z = matrix_objective_of(problem).gradients(columns[0][None])[0] if solution is None else solution.Z[0]
    values, vectors = np.linalg.eigh((Z + Z.T) / 2)
    Z = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return Z / float(np.sum(Z * E))


def _maximise_dual(
    problem: DesignProblem, Z: np.ndarray, inputs: Sequence[np.ndarray], executor: Executor | None
) -> Iterable[LocalSolution]:
    apply = map if executor is None else executor.map
    families = families_of(problem.path)
    return apply(solve_locally, [LocalSolve(problem, "dual", u, (families[0], problem.path), True, LinearObjective(Z)) for u in inputs])


def _improve_from_best(design: Design, solutions: Sequence[LocalSolution]) -> Design:
    """Climb from the best of the paths found where it promises more than the design."""
    problem = design.problem
    if not solutions:
        return design
    best = max(solutions, key=lambda solution: problem.objective(solution.path))
    refined = solve_locally(LocalSolve(problem, "from the dual question", best.u, (problem.path,), True))
    if not refined.status.has_answer or not is_feasible(problem, refined.path):
        return design
    value = problem.objective(refined.path)
    if value <= design.objective * (1 + 1e-6):
        return design
    improved = choose_best(problem, [refined], [refined])
    return replace(improved, starts=(*design.starts, *improved.starts), optima=(*improved.optima, *design.optima))
