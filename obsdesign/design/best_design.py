"""What climbs came to, recomputed by the analysis code, and which of them is the design."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from obsdesign.criteria.log_det import LogDet
from obsdesign.design.feasibility import is_feasible
from obsdesign.design.feasible_search import FeasibilitySearch
from obsdesign.design.local_solve import LocalSolution, LocalSolve, solve_locally
from obsdesign.design.nlp.criterion_objective import CriterionObjective
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design, Optimum, Robustness, Start
from obsdesign.design.sqp.combination import Smallest
from obsdesign.design.upper_bound import Cap, cap_of
from obsdesign.information.gramian import variational_gramian
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

_AGREEMENT = 1e-6  # relative difference allowed between the program's objective and the recomputed one; also between equal optima
_DISTINCT = 1e-4  # relative difference between optima that are not the same
_POSTERIOR_AGREEMENT = 1e-3  # the same, for a posterior: the program's arithmetic is plainer there
_ROUND_OFF_SHARE = 1e-11  # share of the largest eigenvalue below which a smallest one is rounding
_FRESH_DRAWS = 1000  # draws: the share below the 5 % value has a standard error of sqrt(0.05 0.95 / 1000) = 0.7 %
_STOPPED_REASON = "no climb came to an end: the best path that keeps all limits"


@dataclass(frozen=True, eq=False)
class _Attempt:
    """A climb with its objective as the analysis code has it."""

    solution: LocalSolution
    start: Start


def choose_best(
    problem: DesignProblem, coarse: Sequence[LocalSolution], refined: Sequence[LocalSolution], search: FeasibilitySearch | None = None
) -> Design:
    """Return the best of the refined climbs as a Design, with what every start came to.

    search: the path that came nearest to keeping all limits. Where no climb has come to an end, the best path that keeps them is the
    answer, be it that one or where a climb stopped: GAP_OPEN.
    """
    attempts = [_attempt(problem, solution, refined=True) for solution in refined]
    refined_starts = {attempt.start.name: attempt.start for attempt in attempts}
    starts = tuple(refined_starts.get(solution.name) or _attempt(problem, solution, refined=False).start for solution in coarse)
    successful = [attempt for attempt in attempts if attempt.start.status.has_answer]
    if not successful:
        best_feasible = _best_feasible(problem, (*coarse, *refined), search)
        return (
            _design_without_answer(problem, starts)
            if best_feasible is None
            else replace(_build_design(problem, best_feasible, starts, cap_of(problem)), reason=_STOPPED_REASON)
        )
    cap = cap_of(problem)
    best = max(attempt.start.value for attempt in successful)
    tied = [attempt for attempt in successful if attempt.start.value >= best - _AGREEMENT * abs(best)]
    attempt = max(tied, key=lambda candidate: _log_det(problem, candidate.solution.path))
    if cap is not None and cap.value > 0 and not problem.prices and attempt.start.value >= cap.value * (1 - _AGREEMENT):
        attempt = _break_tie(problem, attempt, cap)
    return _build_design(problem, attempt, starts, cap)


def _attempt(problem: DesignProblem, solution: LocalSolution, refined: bool) -> _Attempt:
    status, value = solution.status, np.nan
    if status.has_answer:
        value = problem.objective(solution.path)
        agreement = _AGREEMENT if problem.criterion.knowledge is None else _POSTERIOR_AGREEMENT
        tolerance = max(
            agreement * abs(value), problem.criterion.resolution, _ROUND_OFF_SHARE * float(np.abs(problem.matrix(solution.path)).max())
        )
        if not abs(value - solution.objective) <= tolerance or (refined and not is_feasible(problem, solution.path)):
            status, value = Status.NUMERICAL_ERROR, np.nan
    return _Attempt(solution, Start(solution.name, status, value, solution.iterations, solution.residual, refined))


def _log_det(problem: DesignProblem, path: Trajectory) -> float:
    return LogDet().value(problem.matrix(path))


def _break_tie(problem: DesignProblem, attempt: _Attempt, cap: Cap) -> _Attempt:
    """Among the paths that reach the cap, on which it does not determine one, climb to the largest log det."""
    objective = CriterionObjective(LogDet(), problem.about_indices, Smallest())
    local_solve = LocalSolve(
        problem, attempt.start.name, attempt.solution.u, (problem.path,), True, objective, cap.value * (1 - 0.9 * _AGREEMENT)
    )
    solution = solve_locally(local_solve)
    if not solution.status.has_answer or _log_det(problem, solution.path) <= _log_det(problem, attempt.solution.path):
        return attempt
    value = problem.objective(solution.path)
    if value < cap.value * (1 - _AGREEMENT) or not is_feasible(problem, solution.path):
        return attempt
    iterations = attempt.start.iterations + solution.iterations
    return _Attempt(solution, replace(attempt.start, value=value, iterations=iterations, residual=solution.residual))


def _build_design(problem: DesignProblem, attempt: _Attempt, starts: tuple[Start, ...], cap: Cap | None) -> Design:
    path, start = attempt.solution.path, attempt.start
    eigenvalues = np.linalg.eigvalsh(problem.matrix(path))
    return Design(
        problem=problem,
        trajectory=path,
        information=variational_gramian(problem.system, path),
        value=problem.value(path),
        ended=start.status,
        starts=starts,
        cap=cap,
        objective=start.value,
        p=attempt.solution.p,
        eigenvalues=(float(eigenvalues[0]), float(eigenvalues[min(1, len(eigenvalues) - 1)])),
        residual=start.residual,
        iterations=start.iterations,
        optima=distinct_optima(starts),
        robustness=_robustness(problem, path),
    )


def distinct_optima(starts: Sequence[Start]) -> tuple[Optimum, ...]:
    """Return the distinct values of the refined starts, best first."""
    optima: list[Optimum] = []
    for start in sorted(
        (candidate for candidate in starts if candidate.status.has_answer and candidate.refined), key=lambda candidate: -candidate.value
    ):
        if optima and abs(optima[-1].value - start.value) <= _DISTINCT * abs(optima[-1].value):
            optima[-1] = Optimum(optima[-1].value, (*optima[-1].starts, start.name))
        else:
            optima.append(Optimum(start.value, (start.name,)))
    return tuple(optima)


def _robustness(problem: DesignProblem, path: Trajectory) -> Robustness | None:
    if problem.robust is None:
        return None
    values = np.sort(problem.values(problem.robust.draws(_FRESH_DRAWS, 1), path.u))
    return Robustness(_FRESH_DRAWS, float(values[0]), float(values[_FRESH_DRAWS // 20]), float(values.mean()))


def _best_feasible(problem: DesignProblem, solutions: Sequence[LocalSolution], search: FeasibilitySearch | None) -> _Attempt | None:
    """The best path that keeps all limits of those that climbs stopped at and of the one that was looked for; None without."""
    feasible = [solution for solution in solutions if is_feasible(problem, solution.path)]
    if search is not None and search.is_feasible:
        feasible.append(as_local_solution(search))
    attempts = [
        _Attempt(solution, Start(solution.name, Status.GAP_OPEN, problem.objective(solution.path), solution.iterations, solution.residual))
        for solution in feasible
    ]
    return max(attempts, key=lambda attempt: np.nan_to_num(attempt.start.value, nan=-np.inf), default=None)


def as_local_solution(search: FeasibilitySearch) -> LocalSolution:
    """Return a path that keeps all limits as what no climb has come to."""
    return LocalSolution("a path within the limits", search.p, search.path.u, search.path, np.nan, Status.GAP_OPEN, 0, np.nan, None)


def _design_without_answer(problem: DesignProblem, starts: tuple[Start, ...]) -> Design:
    """A design without an answer: the study's "no" only where every start says so."""
    statuses = {start.status for start in starts}
    is_infeasible = statuses <= {Status.LOCALLY_INFEASIBLE}
    status = Status.LOCALLY_INFEASIBLE if is_infeasible else min(statuses - {Status.LOCALLY_INFEASIBLE}, key=list(Status).index)
    return Design(problem, None, None, np.nan, status, starts, cap_of(problem))
