"""Shaping a path: gate, starts, solve, recompute, choose."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from itertools import islice

import numpy as np

from obsdesign.analysis.question import observability
from obsdesign.checks import require_count
from obsdesign.criteria.log_det import LogDet
from obsdesign.design.caps import cap_of
from obsdesign.design.problem import Design, DesignProblem, Start
from obsdesign.design.starts import start_inputs
from obsdesign.design.transcription import Solution, solve, transcribe
from obsdesign.errors import SolveError, UnobservableError
from obsdesign.information.gramian import variational_gramian
from obsdesign.information.record import Information
from obsdesign.simulation import simulate
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

_AGREEMENT = 1e-6  # relative difference allowed between the solver's objective and the recomputed value
_SKIPPED = 20
_Attempt = tuple[Start, Trajectory, Information]


def design_trajectory(
    problem: DesignProblem, starts: int = 8, seed: int = 0, executor: Executor | None = None, throw: bool = True
) -> Design:
    """Return the best of several locally optimal paths, every claim recomputed from the path itself.

    Gate: a system whose sensors cannot see the whole state on any path is refused. Each start is one task for the executor.
    Raises UnobservableError, and SolveError when no start ends in an answer (throw=False: the failed Design instead).
    Source: the lift of lambda_min, max t s.t. S W S / c - t I = L L'; Brace and Morgansen for the aim.
    """
    require_count("starts", starts)
    require_count("seed", seed, least=0)
    verdict = observability(problem.system, seed=seed)
    if verdict.decided and not verdict.observable:
        raise UnobservableError(verdict)
    names, guesses = zip(*islice(_usable_starts(problem, seed), starts), strict=True)
    apply = map if executor is None else executor.map
    solutions = list(apply(solve, [problem] * starts, guesses))
    attempts = [_recomputed(problem, name, solution) for name, solution in zip(names, solutions, strict=True)]
    design = _chosen(problem, attempts)
    if throw and not design.status.has_answer:
        raise SolveError(f"trajectory design, all {starts} starts", design.status)
    return design


def _usable_starts(problem: DesignProblem, seed: int) -> Iterator[tuple[str, np.ndarray]]:
    """Yield names and parameters of starts whose information is not singular: there the lift has no way to go.

    A weave that the path family is too coarse for averages out to a straight line, for instance. After twenty singular ones,
    whatever comes is used.
    """
    skipped = 0
    for name, u in start_inputs(problem, seed):
        p = problem.path.fit(u)
        W = transcribe(problem).information(p).full()
        if np.isfinite(LogDet().value(W)) or skipped >= _SKIPPED:
            yield name, p
        else:
            skipped += 1


def _recomputed(problem: DesignProblem, name: str, solution: Solution) -> _Attempt:
    u = np.array(problem.path.inputs(solution.p, problem.steps))  # pyright: ignore[reportArgumentType]  # serves both kinds
    path = simulate(problem.system, problem.x0, u, problem.step)
    information = variational_gramian(problem.system, path)
    value = problem.value(path)
    status = solution.status
    agrees = abs(value - solution.objective) <= max(_AGREEMENT * abs(value), problem.criterion.resolution)
    if status.has_answer and not (agrees and problem.is_feasible(path.x)):
        status = Status.NUMERICAL_ERROR
    value = value if status.has_answer else np.nan
    return Start(name, status, value, solution.iterations, solution.residual), path, information


def _chosen(problem: DesignProblem, attempts: list[_Attempt]) -> Design:
    starts = tuple(start for start, _, _ in attempts)
    answered = [attempt for attempt in attempts if attempt[0].status.has_answer]
    if not answered:
        # the study's "no" only where every start says so
        statuses = {start.status for start in starts}
        status = statuses.pop() if len(statuses) == 1 else min(statuses - {Status.LOCALLY_INFEASIBLE}, key=list(Status).index)
        return Design(problem, None, None, np.nan, status, starts, cap_of(problem))
    best = max(start.value for start, _, _ in answered)
    tied = [attempt for attempt in answered if attempt[0].value >= best - _AGREEMENT * abs(best)]
    start, path, information = max(tied, key=lambda attempt: LogDet().value(problem.scaled(attempt[2].total)))
    return Design(problem, path, information, start.value, start.status, starts, cap_of(problem))
