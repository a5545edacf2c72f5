"""Shaping a path: gate, starts, coarse climbs, refinement, recomputation, choice."""

from __future__ import annotations

from collections.abc import Sequence
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
from obsdesign.design.climbs import climb, usable_starts
from obsdesign.design.dual_estimate import evidence_for
from obsdesign.design.feasibility import is_feasible
from obsdesign.design.feasible_search import FeasibilitySearch, search_feasible_path
from obsdesign.design.gap_search import GapSettings, search_to_gap
from obsdesign.design.infeasibility import explain, why_hidden, why_unreachable
from obsdesign.design.local_solve import LocalSolution, LocalSolve, solve_locally
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design, Start
from obsdesign.design.upper_bound import cap_of
from obsdesign.errors import InputError, SolveError
from obsdesign.paths.dubins_path import DubinsPath
from obsdesign.progress import Progress, StageReport
from obsdesign.status import Status

_LOGGER = getLogger(__name__)
_ON_FLOORS = 6  # with a floor: starts that a path is looked for from where no climb has an answer


@validate_arguments
def design_trajectory(
    problem: DesignProblem,
    starts: int = 8,
    seed: int = 0,
    executor: Executor | None = None,
    throw: bool = True,
    evidence: int = 0,
    *,
    gap: float | None = None,
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
        gap: go on from more starts, of which some are rounded from the relaxation behind `bound`, until `design.gap` is at most this, or
            8 times `starts` were climbed from: work, not seconds, so that the answer is the same on every machine. `design.search` has how
            it ended. None = from `starts`.
        progress: is called with what is being done, as it begins; None = nobody is told.
    Raises UnobservableError, and SolveError when no start ends in an answer. Source of the aim: Brace and Morgansen.
    """
    require_count("starts", starts)
    require_count("seed", seed, minimum=0)
    require_count("evidence", evidence, minimum=0)
    if gap is not None and not 0 <= gap < 1:
        raise InputError(f"gap: is {gap:g}: must be at least 0 and less than 1")
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
        design = _design(problem, starts, seed, gap, executor, report)
        if evidence and design.ended.has_answer:
            report(f"{evidence} local solves about how much better another path might be")
            design = evidence_for(design, evidence, seed, executor, report)
    design = replace(design, seconds=perf_counter() - start_time)
    if throw and not design.ended.has_answer:
        raise SolveError(
            f"trajectory design, all {len(design.starts)} starts" if design.starts else "trajectory design", design.ended, design.reason
        )
    return design


def _design(problem: DesignProblem, starts: int, seed: int, gap: float | None, executor: Executor | None, report: StageReport) -> Design:
    """Design from so many starts, or to a gap: then, with a duration that is free, for the one that is best from so many starts."""
    if gap is None:
        return _best_duration(problem, starts, seed, executor, report)
    settings = GapSettings(gap, starts, seed, executor)
    design = search_to_gap(problem, settings, report) if problem.shortest == problem.longest else None
    if design is not None:
        return design
    design = _best_duration(problem, starts, seed, executor, report)
    return (search_to_gap(design.problem, settings, report, design) or design) if design.ended.has_answer else design


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
    start_pairs = list(islice(usable_starts(problem, seed), starts))
    if near is not None and near.trajectory is not None:
        start_pairs = [("that of another duration", _stretch(near.trajectory.u, problem.steps)), *start_pairs[: max(1, starts // 2)]]
    search = None
    if problem.floor is None and (problem.constraints or problem.budgets or problem.rates):
        report(f"{problem.duration:g} s: a path within the limits")
        search = search_feasible_path(problem, seed, _search_inputs(problem, start_pairs))
        if not search.is_feasible:
            failed_starts = tuple(Start(name, Status.LOCALLY_INFEASIBLE, np.nan, 0, np.nan) for name, _ in start_pairs)
            return _DesignAttempt(Design(problem, None, None, np.nan, Status.LOCALLY_INFEASIBLE, failed_starts, cap_of(problem)), search)
    climbs = climb(problem, start_pairs, executor, report)
    coarse, refined = climbs.coarse, climbs.refined
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


def _stretch(u: np.ndarray, steps: int) -> np.ndarray:
    return u[np.minimum(np.arange(steps) * len(u) // steps, len(u) - 1)]
