"""Shaping a path: gate, starts, coarse climbs, refinement, recomputation, choice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import islice
from logging import getLogger
from time import perf_counter

import numpy as np

from obsdesign.analysis.query import observability
from obsdesign.analysis.verdict import UnobservableError
from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count
from obsdesign.design.best_design import choose_best
from obsdesign.design.dual_estimate import evidence_for
from obsdesign.design.feasibility import is_feasible
from obsdesign.design.feasible_search import FeasibilitySearch, search_feasible_path
from obsdesign.design.infeasibility import explain, why_hidden, why_unreachable
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import LocalSolution, LocalSolve, families_of, solve_locally
from obsdesign.design.nlp.criterion_objective import matrix_objective_of
from obsdesign.design.nlp.program import Program
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design, Start
from obsdesign.design.sqp.matrix_objective import evaluate_objective
from obsdesign.design.upper_bound import cap_of
from obsdesign.errors import SolveError
from obsdesign.paths.abstract import AbstractPath
from obsdesign.paths.dubins_path import DubinsPath
from obsdesign.progress import Progress, StageReport
from obsdesign.status import Status

_LOGGER = getLogger(__name__)
_MAX_SKIPPED = 20  # starts without a value that are left out; after so many the others are tried all the same
_FIRST, _ON_FLOORS = 3, 6  # with a floor: climbs that must not all end without an answer, and starts that a path is looked for from then
_NEAR_BEST, _MAX_REFINED = 0.75, 3  # coarse optima that are refined: those above this share of the best, so many at most


@validate_arguments
def design_trajectory(
    problem: DesignProblem,
    starts: int = 8,
    seed: int = 0,
    executor: Executor | None = None,
    throw: bool = True,
    evidence: int = 0,
    *,
    progress: Progress | None = None,
) -> Design:
    """Return the best of several locally optimal paths, every claim recomputed from the path itself.

    max over parameters p of criterion(S W(p) S) - prices, within the limits; the smallest eigenvalue as max t with W - t I >= 0.
    A system whose sensors cannot see the whole state on any path is refused first. Starts are solved in a coarse family; the best
    are refined.

    Arguments:
        problem: what is asked of the path.
        starts: number of initial guesses.
        seed: seed of the random ones.
        executor: runs the local solves, one task each; the answer is the same for any number of workers.
        throw: False = return the failed Design instead of raising SolveError.
        evidence: number of local solves that ask how much better another path might be; 0 = none.
        progress: is called with what is being done, as it begins; None = nobody is told.
    Raises UnobservableError, and SolveError when no start ends in an answer. Source of the aim: Brace and Morgansen.
    """
    require_count("starts", starts)
    require_count("seed", seed, minimum=0)
    require_count("evidence", evidence, minimum=0)
    report = StageReport(_LOGGER, progress)
    report("what the sensors can see on any path")
    verdict = observability(problem.system, seed=seed)
    if verdict.decided and not verdict.observable and not problem.about and not np.any(problem.known):
        raise UnobservableError(verdict)
    start_time = perf_counter()
    unreachable = why_unreachable(problem) or why_hidden(problem)
    if unreachable:
        design = Design(problem, None, None, np.nan, Status.INFEASIBLE, (), reason=unreachable)
    else:
        design = _best_duration(problem, starts, seed, executor, report)
        if evidence and design.ended.has_answer:
            report(f"{evidence} local solves about how much better another path might be")
            design = evidence_for(design, evidence, seed, executor)
    design = replace(design, seconds=perf_counter() - start_time)
    if throw and not design.ended.has_answer:
        raise SolveError(
            f"trajectory design, all {len(design.starts)} starts" if design.starts else "trajectory design", design.ended, design.reason
        )
    return design


@dataclass(frozen=True, eq=False)
class _DesignAttempt:
    """A design, and where it has no answer the path that came nearest to keeping all limits."""

    design: Design
    nearest: FeasibilitySearch | None = None

    @property
    def rank(self) -> float:
        """What is maximised, -inf without an answer."""
        return self.design.objective if self.design.ended.has_answer else -np.inf

    @property
    def order(self) -> tuple[bool, float, float]:
        """What is better is larger: an answer, its objective, how near to the limits."""
        answered = self.design.ended.has_answer
        return answered, self.rank, 0.0 if answered or self.nearest is None else self.nearest.margin


def _best_duration(problem: DesignProblem, starts: int, seed: int, executor: Executor | None, report: StageReport) -> Design:
    """Design for durations spread over the range, then for ever closer neighbours of the best."""
    low, high = (round(duration / problem.step) for duration in (problem.shortest, problem.longest))
    spacing = max(1, -(-(high - low) // 4))
    attempts = {
        steps: _design_for_duration(problem.with_duration(steps * problem.step), starts, seed, executor, report)
        for steps in _spread_steps(low, high, spacing)
    }
    while spacing > 1:
        best = max(attempts, key=lambda steps: attempts[steps].order)
        spacing = max(1, spacing // 2)
        for steps in (best - spacing, best + spacing):
            if low <= steps <= high and steps not in attempts:
                near = attempts[best].design
                same = problem.with_duration(steps * problem.step)
                attempts[steps] = _design_for_duration(same, starts, seed, executor, report, near=near)
    return _explain(max(attempts.values(), key=lambda attempt: attempt.order), seed)


def _spread_steps(low: int, high: int, spacing: int) -> list[int]:
    return sorted({*range(low, high, spacing), high})


def _explain(attempt: _DesignAttempt, seed: int) -> Design:
    """Return a design; one without an answer with the reason for that, or with an answer that was come upon in looking for it."""
    design, nearest = attempt.design, attempt.nearest
    if design.ended.has_answer or nearest is None or not design.ended.is_infeasible:
        return design
    explanation = explain(design.problem, nearest, seed)
    if explanation.answer is not None:
        return _solve_from_feasible(design.problem, explanation.answer, [], [])
    return replace(design, violations=explanation.violations, reason=explanation.in_words)


def _design_for_duration(
    problem: DesignProblem, starts: int, seed: int, executor: Executor | None, report: StageReport, near: Design | None = None
) -> _DesignAttempt:
    """Design for one duration; near: a design of another duration, whose inputs, stretched, are one of the starts.

    Before anything climbs, a path that keeps all limits is looked for: where many starts lead to none, no climb will.
    """
    apply = map if executor is None else executor.map
    families = families_of(problem.path)
    start_pairs = list(islice(_usable_starts(problem, seed), starts))
    if near is not None and near.trajectory is not None:
        start_pairs = [("that of another duration", _stretch(near.trajectory.u, problem.steps)), *start_pairs[: max(1, starts // 2)]]
    search = None
    if problem.floor is None and (problem.constraints or problem.budgets or problem.rates):
        report(f"{problem.duration:g} s: a path within the limits")
        search = search_feasible_path(problem, seed, _search_inputs(problem, start_pairs))
        if not search.is_feasible:
            failed_starts = tuple(Start(name, Status.LOCALLY_INFEASIBLE, np.nan, 0, np.nan) for name, _ in start_pairs)
            return _DesignAttempt(Design(problem, None, None, np.nan, Status.LOCALLY_INFEASIBLE, failed_starts, cap_of(problem)), search)
    tasks = [LocalSolve(problem, name, u, families[:1], len(families) == 1) for name, u in start_pairs]
    report(f"{problem.duration:g} s: {len(tasks)} local solves{' of a coarse family' if len(families) > 1 else ''}")
    first = len(tasks) if problem.floor is None else _FIRST
    coarse = list(apply(solve_locally, tasks[:first]))
    if any(solution.status.has_answer for solution in coarse):
        coarse += apply(solve_locally, tasks[first:])
    for solution in coarse:
        _LOGGER.debug("%s: %s, objective %g, %d iterations", solution.name, solution.status.value, solution.objective, solution.iterations)
    if len(families) > 1:
        report(f"{problem.duration:g} s: the best of them refined")
    refined = coarse if len(families) == 1 else _refine(problem, families, coarse, executor)
    if any(solution.status.has_answer and is_feasible(problem, solution.path) for solution in refined):
        return _DesignAttempt(choose_best(problem, coarse, refined))
    if search is None:
        search = search_feasible_path(
            problem, seed, tuple(solution.u for solution in refined[:2]), None if problem.floor is None else _ON_FLOORS
        )
    if search.is_feasible:
        return _DesignAttempt(_solve_from_feasible(problem, search, coarse, refined))
    return _DesignAttempt(choose_best(problem, coarse, refined, search), search)


def _search_inputs(problem: DesignProblem, start_pairs: Sequence[tuple[str, np.ndarray]]) -> tuple[np.ndarray, ...]:
    """The starts of the climbs as the first ones to look near, but for a family that takes long to fit."""
    return () if isinstance(problem.path, DubinsPath) else tuple(u for _, u in start_pairs)


def _solve_from_feasible(
    problem: DesignProblem, search: FeasibilitySearch, coarse: Sequence[LocalSolution], refined: Sequence[LocalSolution]
) -> Design:
    """Climb from a path that keeps all limits; that path itself is the answer where the climb has none."""
    solution = solve_locally(LocalSolve(problem, "from a path within the limits", search.path.u, (problem.path,), True))
    return choose_best(problem, [*coarse, solution], [*refined, solution], search)


def _refine(
    problem: DesignProblem, families: tuple[AbstractPath, ...], coarse: Sequence[LocalSolution], executor: Executor | None
) -> list[LocalSolution]:
    """Climb on from the best of the coarse paths through the finer families."""
    apply = map if executor is None else executor.map
    selected = _best_distinct(coarse)
    solutions = apply(
        solve_locally, [LocalSolve(problem, coarse_solution.name, coarse_solution.u, families[1:], True) for coarse_solution in selected]
    )
    return [
        replace(solution, iterations=solution.iterations + coarse_solution.iterations)
        for solution, coarse_solution in zip(solutions, selected, strict=True)
    ]


def _stretch(u: np.ndarray, steps: int) -> np.ndarray:
    return u[np.minimum(np.arange(steps) * len(u) // steps, len(u) - 1)]


def _usable_starts(problem: DesignProblem, seed: int) -> Iterator[tuple[str, np.ndarray]]:
    """Yield names and inputs of starts whose information is not singular, for criteria that do not exist there.

    A weave that the path family is too coarse for averages out to a straight line, for instance. After twenty singular ones,
    whatever comes is used.
    """
    skipped, coarsest = 0, replace(problem, path=families_of(problem.path)[0])
    objective = matrix_objective_of(problem)
    for name, u in start_inputs(problem, seed):
        program = Program(coarsest)
        values = program.evaluate(coarsest.path.fit(u, coarsest.grid))
        if objective.is_cone or np.isfinite(evaluate_objective(objective, values.matrices)) or skipped >= _MAX_SKIPPED:
            yield name, u
        else:
            skipped += 1


def _best_distinct(coarse: Sequence[LocalSolution]) -> list[LocalSolution]:
    """Return the best few distinct coarse optima; where none is feasible, the first few as they are."""
    successful = sorted((solution for solution in coarse if solution.status.has_answer), key=lambda solution: -solution.objective)
    if not successful:
        return list(coarse[:_MAX_REFINED])
    selected: list[LocalSolution] = []
    for candidate in successful:
        is_near_best = candidate.objective >= successful[0].objective - (1 - _NEAR_BEST) * abs(successful[0].objective)
        if (
            is_near_best
            and len(selected) < _MAX_REFINED
            and not any(_is_same_value(candidate.objective, earlier.objective) for earlier in selected)
        ):
            selected.append(candidate)
    return selected


def _is_same_value(a: float, b: float) -> bool:
    return abs(a - b) <= 1e-4 * max(abs(a), abs(b))
