"""Shaping a path: gate, starts, coarse climbs, refinement, recomputation, choice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import islice
from time import perf_counter

import numpy as np

from obsdesign.analysis.query import observability
from obsdesign.analysis.verdict import UnobservableError
from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count
from obsdesign.design.best_design import chosen
from obsdesign.design.dual_estimate import evidence_for
from obsdesign.design.feasibility import is_feasible
from obsdesign.design.feasible_search import Sought, sought
from obsdesign.design.infeasibility import explained, why_hidden, why_unreachable
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import Climbed, Task, climbed, families_of
from obsdesign.design.nlp.program import Program
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design, Start
from obsdesign.design.sqp.matrix_objective import aim_of, value_of
from obsdesign.design.upper_bound import cap_of
from obsdesign.errors import SolveError
from obsdesign.paths.abstract import AbstractPath
from obsdesign.paths.dubins_path import DubinsPath
from obsdesign.status import Status

_SKIPPED = 20  # starts without a value that are left out; after so many the others are tried all the same
_FIRST, _ON_FLOORS = 3, 6  # with a floor: climbs that must not all end without an answer, and starts that a path is looked for from then
_NEAR, _KEPT = 0.75, 3  # coarse optima that are refined: those above this share of the best, so many at most


@validate_arguments
def design_trajectory(
    problem: DesignProblem,
    starts: int = 8,
    seed: int = 0,
    executor: Executor | None = None,
    throw: bool = True,
    evidence: int = 0,
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
    Raises UnobservableError, and SolveError when no start ends in an answer. Source of the aim: Brace and Morgansen.
    """
    require_count("starts", starts)
    require_count("seed", seed, least=0)
    require_count("evidence", evidence, least=0)
    verdict = observability(problem.system, seed=seed)
    if verdict.decided and not verdict.observable and not problem.about and not np.any(problem.known):
        raise UnobservableError(verdict)
    began = perf_counter()
    unreachable = why_unreachable(problem) or why_hidden(problem)
    if unreachable:
        design = Design(problem, None, None, np.nan, Status.INFEASIBLE, (), reason=unreachable)
    else:
        design = _best_duration(problem, starts, seed, executor)
        if evidence and design.status.has_answer:
            design = evidence_for(design, evidence, seed, executor)
    design = replace(design, seconds=perf_counter() - began)
    if throw and not design.status.has_answer:
        raise SolveError(
            f"trajectory design, all {len(design.starts)} starts" if design.starts else "trajectory design", design.status, design.reason
        )
    return design


@dataclass(frozen=True, eq=False)
class _Designed:
    """A design, and where it has no answer the path that came nearest to keeping all limits."""

    design: Design
    nearest: Sought | None = None

    @property
    def rank(self) -> float:
        """What is maximised, -inf without an answer."""
        return self.design.objective if self.design.status.has_answer else -np.inf

    @property
    def order(self) -> tuple[bool, float, float]:
        """What is better is larger: an answer, its objective, how near to the limits."""
        answered = self.design.status.has_answer
        return answered, self.rank, 0.0 if answered or self.nearest is None else self.nearest.margin


def _best_duration(problem: DesignProblem, starts: int, seed: int, executor: Executor | None) -> Design:
    """Design for durations spread over the range, then for ever closer neighbours of the best."""
    low, high = (round(duration / problem.step) for duration in (problem.shortest, problem.longest))
    spacing = max(1, -(-(high - low) // 4))
    found = {steps: _designed(problem.lasting(steps * problem.step), starts, seed, executor) for steps in _between(low, high, spacing)}
    while spacing > 1:
        best = max(found, key=lambda steps: found[steps].order)
        spacing = max(1, spacing // 2)
        for steps in (best - spacing, best + spacing):
            if low <= steps <= high and steps not in found:
                near = found[best].design
                found[steps] = _designed(problem.lasting(steps * problem.step), starts, seed, executor, near=near)
    return _explained(max(found.values(), key=lambda each: each.order), seed)


def _between(low: int, high: int, spacing: int) -> list[int]:
    return sorted({*range(low, high, spacing), high})


def _explained(found: _Designed, seed: int) -> Design:
    """Return a design; one without an answer with the reason for that, or with an answer that was come upon in looking for it."""
    design, nearest = found.design, found.nearest
    if design.status.has_answer or nearest is None or not design.status.is_infeasible:
        return design
    why = explained(design.problem, nearest, seed)
    if why.answer is not None:
        return _from_within(design.problem, why.answer, [], [])
    return replace(design, shortfalls=why.shortfalls, reason=why.in_words)


def _designed(problem: DesignProblem, starts: int, seed: int, executor: Executor | None, near: Design | None = None) -> _Designed:
    """Design for one duration; near: a design of another duration, whose inputs, stretched, are one of the starts.

    Before anything climbs, a path that keeps all limits is looked for: where many starts lead to none, no climb will.
    """
    apply = map if executor is None else executor.map
    families = families_of(problem.path)
    named = list(islice(_usable_starts(problem, seed), starts))
    if near is not None and near.trajectory is not None:
        named = [("that of another duration", _stretched(near.trajectory.u, problem.steps)), *named[: max(1, starts // 2)]]
    within = None
    if problem.floor is None and (problem.constraints or problem.budgets or problem.rates):
        within = sought(problem, seed, _known(problem, named))
        if not within.keeps_all:
            gone = tuple(Start(name, Status.LOCALLY_INFEASIBLE, np.nan, 0, np.nan) for name, _ in named)
            return _Designed(Design(problem, None, None, np.nan, Status.LOCALLY_INFEASIBLE, gone, cap_of(problem)), within)
    tasks = [Task(problem, name, u, families[:1], len(families) == 1) for name, u in named]
    first = len(tasks) if problem.floor is None else _FIRST
    coarse = list(apply(climbed, tasks[:first]))
    if any(each.status.has_answer for each in coarse):
        coarse += apply(climbed, tasks[first:])
    refined = coarse if len(families) == 1 else _refined(problem, families, coarse, executor)
    if any(each.status.has_answer and is_feasible(problem, each.path) for each in refined):
        return _Designed(chosen(problem, coarse, refined))
    if within is None:
        within = sought(problem, seed, tuple(each.u for each in refined[:2]), None if problem.floor is None else _ON_FLOORS)
    if within.keeps_all:
        return _Designed(_from_within(problem, within, coarse, refined))
    return _Designed(chosen(problem, coarse, refined, within), within)


def _known(problem: DesignProblem, named: Sequence[tuple[str, np.ndarray]]) -> tuple[np.ndarray, ...]:
    """The starts of the climbs as the first ones to look near, but for a family that takes long to fit."""
    return () if isinstance(problem.path, DubinsPath) else tuple(u for _, u in named)


def _from_within(problem: DesignProblem, within: Sought, coarse: Sequence[Climbed], refined: Sequence[Climbed]) -> Design:
    """Climb from a path that keeps all limits; that path itself is the answer where the climb has none."""
    rescue = climbed(Task(problem, "from a path within the limits", within.path.u, (problem.path,), True))
    return chosen(problem, [*coarse, rescue], [*refined, rescue], within)


def _refined(
    problem: DesignProblem, families: tuple[AbstractPath, ...], coarse: Sequence[Climbed], executor: Executor | None
) -> list[Climbed]:
    """Climb on from the best of the coarse paths through the finer families."""
    apply = map if executor is None else executor.map
    kept = _worth_refining(coarse)
    found = apply(climbed, [Task(problem, each.name, each.u, families[1:], True) for each in kept])
    return [replace(each, iterations=each.iterations + before.iterations) for each, before in zip(found, kept, strict=True)]


def _stretched(u: np.ndarray, steps: int) -> np.ndarray:
    return u[np.minimum(np.arange(steps) * len(u) // steps, len(u) - 1)]


def _usable_starts(problem: DesignProblem, seed: int) -> Iterator[tuple[str, np.ndarray]]:
    """Yield names and inputs of starts whose information is not singular, for criteria that do not exist there.

    A weave that the path family is too coarse for averages out to a straight line, for instance. After twenty singular ones,
    whatever comes is used.
    """
    skipped, coarsest = 0, replace(problem, path=families_of(problem.path)[0])
    aim = aim_of(problem)
    for name, u in start_inputs(problem, seed):
        program = Program(coarsest)
        values = program.at(coarsest.path.fit(u, coarsest.grid))
        if aim.is_cone or np.isfinite(value_of(aim, values.matrices)) or skipped >= _SKIPPED:
            yield name, u
        else:
            skipped += 1


def _worth_refining(coarse: Sequence[Climbed]) -> list[Climbed]:
    """Return the best few distinct coarse optima; where none is feasible, the first few as they are."""
    answered = sorted((each for each in coarse if each.status.has_answer), key=lambda each: -each.objective)
    if not answered:
        return list(coarse[:_KEPT])
    kept: list[Climbed] = []
    for each in answered:
        good = each.objective >= answered[0].objective - (1 - _NEAR) * abs(answered[0].objective)
        if good and len(kept) < _KEPT and not any(_same(each.objective, other.objective) for other in kept):
            kept.append(each)
    return kept


def _same(a: float, b: float) -> bool:
    return abs(a - b) <= 1e-4 * max(abs(a), abs(b))
