"""What climbs came to, recomputed by the analysis code, and which of them is the design."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from obsdesign.criteria.log_det import LogDet
from obsdesign.design.feasibility import is_feasible, price_of
from obsdesign.design.feasible_search import Sought
from obsdesign.design.local_solve import Climbed, Task, climbed
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Cap, Design, Optimum, Robustness, Start
from obsdesign.design.sqp.matrix_objective import Judged
from obsdesign.design.upper_bound import cap_of
from obsdesign.information.gramian import variational_gramian
from obsdesign.status import Status
from obsdesign.trajectory import Trajectory

_AGREEMENT = 1e-6  # relative difference allowed between the program's objective and the recomputed one; also between equal optima
_DISTINCT = 1e-4  # relative difference between optima that are not the same
_SMOOTH = 1e-3  # the same, for a posterior: the program's arithmetic is plainer there
_LOST = 1e-11  # share of the largest eigenvalue below which a smallest one is rounding
_FRESH = 1000  # draws: the share below the 5 % value has a standard error of sqrt(0.05 0.95 / 1000) = 0.7 %
_STOPPED = "no climb came to an end: the best path that keeps all limits"


@dataclass(frozen=True, eq=False)
class _Attempt:
    """A climb with its objective as the analysis code has it."""

    found: Climbed
    start: Start


def chosen(problem: DesignProblem, coarse: Sequence[Climbed], refined: Sequence[Climbed], found: Sought | None = None) -> Design:
    """Return the best of the refined climbs as a Design, with what every start came to.

    found: the path that came nearest to keeping all limits. Where no climb has come to an end, the best path that keeps them is the
    answer, be it that one or where a climb stopped: GAP_OPEN.
    """
    attempts = [_attempt(problem, found, refined=True) for found in refined]
    known = {attempt.start.name: attempt.start for attempt in attempts}
    starts = tuple(known.get(found.name) or _attempt(problem, found, refined=False).start for found in coarse)
    answered = [attempt for attempt in attempts if attempt.start.status.has_answer]
    if not answered:
        stopped = _kept(problem, (*coarse, *refined), found)
        return (
            _failed(problem, starts) if stopped is None else replace(_recorded(problem, stopped, starts, cap_of(problem)), reason=_STOPPED)
        )
    cap = cap_of(problem)
    best = max(attempt.start.value for attempt in answered)
    tied = [attempt for attempt in answered if attempt.start.value >= best - _AGREEMENT * abs(best)]
    attempt = max(tied, key=lambda each: _volume(problem, each.found.path))
    if cap is not None and cap.value > 0 and not problem.prices and attempt.start.value >= cap.value * (1 - _AGREEMENT):
        attempt = _tie_broken(problem, attempt, cap)
    return _recorded(problem, attempt, starts, cap)


def objective_of(problem: DesignProblem, path: Trajectory) -> float:
    """Return what is maximised, recomputed: the criterion of a path, or of the prior's draws along its inputs, minus prices."""
    if problem.robust is None:
        return problem.value(path) - price_of(problem, path)
    each = problem.values(problem.robust.draws(problem.robust.samples, 0), path.u)
    return float(each.min() if problem.robust.worst else each.mean()) - price_of(problem, path)


def _attempt(problem: DesignProblem, found: Climbed, refined: bool) -> _Attempt:
    status, value = found.status, np.nan
    if status.has_answer:
        value = objective_of(problem, found.path)
        agreement = _AGREEMENT if problem.criterion.knowledge is None else _SMOOTH
        allowed = max(agreement * abs(value), problem.criterion.resolution, _LOST * float(np.abs(problem.matrix(found.path)).max()))
        if not abs(value - found.objective) <= allowed or (refined and not is_feasible(problem, found.path)):
            status, value = Status.NUMERICAL_ERROR, np.nan
    return _Attempt(found, Start(found.name, status, value, found.iterations, found.residual, refined))


def _volume(problem: DesignProblem, path: Trajectory) -> float:
    return LogDet().value(problem.matrix(path))


def _tie_broken(problem: DesignProblem, attempt: _Attempt, cap: Cap) -> _Attempt:
    """Among the paths that reach the cap, on which it does not determine one, climb to the largest log det."""
    aim = Judged(LogDet(), problem.judged_states, of_worst=True)
    task = Task(problem, attempt.start.name, attempt.found.u, (problem.path,), True, aim, cap.value * (1 - 0.9 * _AGREEMENT))
    found = climbed(task)
    if not found.status.has_answer or _volume(problem, found.path) <= _volume(problem, attempt.found.path):
        return attempt
    value = objective_of(problem, found.path)
    if value < cap.value * (1 - _AGREEMENT) or not is_feasible(problem, found.path):
        return attempt
    iterations = attempt.start.iterations + found.iterations
    return _Attempt(found, replace(attempt.start, value=value, iterations=iterations, residual=found.residual))


def _recorded(problem: DesignProblem, attempt: _Attempt, starts: tuple[Start, ...], cap: Cap | None) -> Design:
    path, start = attempt.found.path, attempt.start
    eigenvalues = np.linalg.eigvalsh(problem.matrix(path))
    return Design(
        problem=problem,
        trajectory=path,
        information=variational_gramian(problem.system, path),
        value=problem.value(path),
        status=start.status,
        starts=starts,
        cap=cap,
        objective=start.value,
        p=attempt.found.p,
        eigenvalues=(float(eigenvalues[0]), float(eigenvalues[min(1, len(eigenvalues) - 1)])),
        residual=start.residual,
        iterations=start.iterations,
        optima=_optima(starts),
        robustness=_robustness(problem, path),
    )


def _optima(starts: Sequence[Start]) -> tuple[Optimum, ...]:
    """The distinct values of the refined starts, best first."""
    found: list[Optimum] = []
    for start in sorted((each for each in starts if each.status.has_answer and each.refined), key=lambda each: -each.value):
        if found and abs(found[-1].value - start.value) <= _DISTINCT * abs(found[-1].value):
            found[-1] = Optimum(found[-1].value, (*found[-1].starts, start.name))
        else:
            found.append(Optimum(start.value, (start.name,)))
    return tuple(found)


def _robustness(problem: DesignProblem, path: Trajectory) -> Robustness | None:
    if problem.robust is None:
        return None
    each = np.sort(problem.values(problem.robust.draws(_FRESH, 1), path.u))
    return Robustness(_FRESH, float(each[0]), float(each[_FRESH // 20]), float(each.mean()))


def _kept(problem: DesignProblem, climbs: Sequence[Climbed], found: Sought | None) -> _Attempt | None:
    """The best path that keeps all limits of those that climbs stopped at and of the one that was looked for; None without."""
    ends = [each for each in climbs if is_feasible(problem, each.path)]
    if found is not None and found.keeps_all:
        ends.append(unclimbed(found))
    attempts = [
        _Attempt(each, Start(each.name, Status.GAP_OPEN, objective_of(problem, each.path), each.iterations, each.residual)) for each in ends
    ]
    return max(attempts, key=lambda each: np.nan_to_num(each.start.value, nan=-np.inf), default=None)


def unclimbed(found: Sought) -> Climbed:
    """Return a path that keeps all limits as what no climb has come to."""
    return Climbed("a path within the limits", found.p, found.path.u, found.path, np.nan, Status.GAP_OPEN, 0, np.nan, None)


def _failed(problem: DesignProblem, starts: tuple[Start, ...]) -> Design:
    """A design without an answer: the study's "no" only where every start says so."""
    statuses = {start.status for start in starts}
    no = statuses <= {Status.LOCALLY_INFEASIBLE}
    status = Status.LOCALLY_INFEASIBLE if no else min(statuses - {Status.LOCALLY_INFEASIBLE}, key=list(Status).index)
    return Design(problem, None, None, np.nan, status, starts, cap_of(problem))
