"""Local solves from several starts: all in a coarse family, the best of them refined."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from logging import getLogger

import numpy as np

from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import LocalSolution, LocalSolve, families_of, solve_locally
from obsdesign.design.nlp.criterion_objective import matrix_objective_of
from obsdesign.design.nlp.program import Program
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.matrix_objective import evaluate_objective
from obsdesign.design.upper_bound import cap_of
from obsdesign.paths.abstract import AbstractPath
from obsdesign.progress import StageReport

_LOGGER = getLogger(__name__)
_MAX_SKIPPED = 20  # starts without a value that are left out; after so many the others are tried all the same
_FIRST = 3  # climbs before the others, which may be abandoned below them; with a floor they must not all end without an answer
# coarse optima are the same where values are, or where values are near and parameters within this share of the box
_SAME_VALUE, _NEAR_VALUE, _SAME_PLACE = 1e-4, 1e-2, 0.05
_NEAR_BEST, _MAX_REFINED = 0.75, 3  # coarse optima that are refined: those above this share of the best, so many at most


@dataclass(frozen=True, eq=False)
class Climbs:
    """Where climbs in the coarse family ended, and those that were refined; of one family both are the same."""

    coarse: tuple[LocalSolution, ...] = ()
    refined: tuple[LocalSolution, ...] = ()


def climb(
    problem: DesignProblem,
    starts: Sequence[tuple[str, np.ndarray]],
    executor: Executor | None,
    report: StageReport,
    target: float = -np.inf,
) -> Climbs:
    """Climb from names and inputs (N, m) in the coarsest family, from the best few that differ on through the finer ones.

    target: an objective that is there; climbs that creep below it are stopped, coarse ones that creep where none is refined. The first
    three, and the first that is refined, set it for the others.
    """
    apply = map if executor is None else executor.map
    families, cap = families_of(problem.path), cap_of(problem)
    ceiling = np.inf if cap is None else cap.value
    report(f"{problem.duration:g} s: {len(starts)} local solves{' of a coarse family' if len(families) > 1 else ''}")
    coarse: list[LocalSolution] = []
    for batch in (starts[:_FIRST], starts[_FIRST:]):
        if coarse and problem.floor is not None and not any(solution.status.has_answer for solution in coarse):
            break
        best = _best_objective(coarse, target)
        coarse_target = best if len(families) == 1 else near_best(best)
        tasks = [LocalSolve(problem, name, u, families[:1], len(families) == 1, target=coarse_target, ceiling=ceiling) for name, u in batch]
        coarse += report.count(apply(solve_locally, tasks), len(starts), "local solves done", len(coarse))
    for solution in coarse:
        _LOGGER.debug("%s: %s, objective %g, %d iterations", solution.name, solution.status.value, solution.objective, solution.iterations)
    if len(families) == 1:
        return Climbs(tuple(coarse), tuple(coarse))
    report(f"{problem.duration:g} s: the best of them refined")
    return Climbs(tuple(coarse), _refine(problem, families, coarse, executor, (target, ceiling), report))


def _best_objective(solutions: Sequence[LocalSolution], target: float) -> float:
    return max([target, *(solution.objective for solution in solutions if solution.status.has_answer)])


def near_best(best: float) -> float:
    """Return the objective from which on a coarse optimum may be refined to one that is better than the best."""
    return best - (1 - _NEAR_BEST) * abs(best) if np.isfinite(best) else best


def _refine(
    problem: DesignProblem,
    families: tuple[AbstractPath, ...],
    coarse: Sequence[LocalSolution],
    executor: Executor | None,
    marks: tuple[float, float],
    report: StageReport,
) -> tuple[LocalSolution, ...]:
    """Climb on from the best of the coarse paths through the finer ones: first from the best, then from others that may beat it.

    marks: an objective that is there, and what none exceeds.
    """
    apply, (target, ceiling) = map if executor is None else executor.map, marks
    lower, upper = families[0].box(problem.grid)
    candidates, refined = _best_distinct(coarse, target, upper - lower), []
    near = _near_the_best(candidates, target)
    for is_first in (True, False):
        batch = near[:1] if is_first else candidates[1:] if _gains_much(near[:1], refined) else near[1:]
        target = _best_objective(refined, target)
        tasks = [LocalSolve(problem, solution.name, solution.u, families[1:], True, target=target, ceiling=ceiling) for solution in batch]
        solutions = report.count(apply(solve_locally, tasks), len(refined) + len(batch), "refined", len(refined))
        refined += [
            replace(solution, iterations=solution.iterations + coarse_solution.iterations)
            for solution, coarse_solution in zip(solutions, batch, strict=True)
        ]
    return tuple(refined)


def usable_starts(problem: DesignProblem, seed: int) -> Iterator[tuple[str, np.ndarray]]:
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


def _best_distinct(coarse: Sequence[LocalSolution], target: float, width: np.ndarray) -> list[LocalSolution]:
    """Return the best few distinct coarse optima; where there is none, the first few, but for a target that is there.

    width (q,): of the box of the coarse family.
    """
    successful = sorted((solution for solution in coarse if solution.status.has_answer), key=lambda solution: -solution.objective)
    if not successful:
        return list(coarse[: 0 if np.isfinite(target) else _MAX_REFINED])
    selected: list[LocalSolution] = []
    for candidate in successful:
        is_same = any(_is_same_optimum(candidate, earlier, width) for earlier in selected)
        if len(selected) < _MAX_REFINED and not is_same:
            selected.append(candidate)
    return selected


def _near_the_best(candidates: Sequence[LocalSolution], target: float) -> list[LocalSolution]:
    """Those coarse optima, the best one first, from which a finer climb may end above the best of them and an objective that is there."""
    if not candidates or not candidates[0].status.has_answer:
        return list(candidates)
    lowest = near_best(max(target, candidates[0].objective))
    return [candidate for candidate in candidates if candidate.objective >= lowest]


def _gains_much(coarse: Sequence[LocalSolution], refined: Sequence[LocalSolution]) -> bool:
    """Whether the first finer climb gained more than coarse optima may lie apart: then those say little of where climbs from them end."""
    return any(
        before.objective < near_best(after.objective)
        for before, after in zip(coarse, refined, strict=True)
        if before.status.has_answer and after.status.has_answer
    )


def _is_same_optimum(a: LocalSolution, b: LocalSolution, width: np.ndarray) -> bool:
    """Whether two coarse solves, neither of which is exact, were about to end in the same place."""
    difference = abs(a.objective - b.objective) / max(abs(a.objective), abs(b.objective), np.finfo(float).tiny)
    return difference <= _SAME_VALUE or (difference <= _NEAR_VALUE and bool((np.abs(a.p - b.p) <= _SAME_PLACE * width).all()))
