"""Shaping a path: gate, starts, coarse climbs, refinement, recomputation, choice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from itertools import islice
from time import perf_counter

import numpy as np

from obsdesign.analysis.question import observability
from obsdesign.arguments import validate_arguments
from obsdesign.checks import require_count
from obsdesign.design.aim import aim_of, value_of
from obsdesign.design.choosing import chosen
from obsdesign.design.climbing import Climbed, Task, climbed, families_of
from obsdesign.design.evidence import evidence_for
from obsdesign.design.infeasibility import nearest_to_limits, rescued, why_unreachable
from obsdesign.design.limits import is_feasible
from obsdesign.design.problem import DesignProblem
from obsdesign.design.program import Program
from obsdesign.design.record import Design
from obsdesign.design.starts import start_inputs
from obsdesign.errors import SolveError, UnobservableError
from obsdesign.paths.abstract import AbstractPath
from obsdesign.status import Status

_SKIPPED = 20
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

    Gate: a system whose sensors cannot see the whole state on any path is refused. Starts climb in a coarse family first; the best
    are refined. evidence: climbs that ask how much better another path might be. Each climb is one task for the executor.
    Raises UnobservableError, and SolveError when no start ends in an answer (throw=False: the failed Design instead).
    Source: matrix inequality W - t I >= 0 for the smallest eigenvalue; Brace and Morgansen for the aim.
    """
    require_count("starts", starts)
    require_count("seed", seed, least=0)
    require_count("evidence", evidence, least=0)
    verdict = observability(problem.system, seed=seed)
    if verdict.decided and not verdict.observable and not problem.about and not np.any(problem.known):
        raise UnobservableError(verdict)
    began = perf_counter()
    unreachable = why_unreachable(problem)
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


def _best_duration(problem: DesignProblem, starts: int, seed: int, executor: Executor | None) -> Design:
    """Design for durations spread over the range, then for ever closer neighbours of the best."""
    if problem.shortest == problem.longest:
        return _designed(problem.lasting(problem.longest), starts, seed, executor)
    low, high = (round(duration / problem.step) for duration in (problem.shortest, problem.longest))
    spacing = max(1, -(-(high - low) // 4))
    found = {steps: _designed(problem.lasting(steps * problem.step), starts, seed, executor) for steps in _between(low, high, spacing)}
    while spacing > 1:
        best = max(found, key=lambda steps: _rank(found[steps]))
        spacing = max(1, spacing // 2)
        for steps in (best - spacing, best + spacing):
            if low <= steps <= high and steps not in found:
                found[steps] = _designed(problem.lasting(steps * problem.step), starts, seed, executor, near=found[best])
    return max(found.values(), key=_rank)


def _between(low: int, high: int, spacing: int) -> list[int]:
    return sorted({*range(low, high, spacing), high})


def _rank(design: Design) -> float:
    return design.objective if design.status.has_answer else -np.inf


def _designed(problem: DesignProblem, starts: int, seed: int, executor: Executor | None, near: Design | None = None) -> Design:
    """Design for one duration; near: a design of another duration, whose inputs, stretched, are one of the starts."""
    apply = map if executor is None else executor.map
    families = families_of(problem.path)
    named = list(islice(_usable_starts(problem, seed), starts))
    if near is not None and near.trajectory is not None:
        named = [("that of another duration", _stretched(near.trajectory.u, problem.steps)), *named[: max(1, starts // 2)]]
    coarse = list(apply(climbed, [Task(problem, name, u, families[:1], len(families) == 1) for name, u in named]))
    refined = coarse if len(families) == 1 else _refined(problem, families, coarse, executor)
    if any(each.status.has_answer and is_feasible(problem, each.path) for each in refined):
        return chosen(problem, coarse, refined)
    nearest = nearest_to_limits(problem, refined)
    rescue = rescued(problem, nearest)
    more = [] if rescue is None else [rescue]
    return chosen(problem, [*coarse, *more], [*refined, *more], nearest)


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
