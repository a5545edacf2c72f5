"""How much better might another path be: the dual question, asked from several starts."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from obsdesign.design.aim import Linear
from obsdesign.design.choosing import chosen, objective_of
from obsdesign.design.climbing import Climbed, Task, climbed, families_of
from obsdesign.design.limits import is_feasible
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design, Evidence
from obsdesign.design.starts import start_inputs
from obsdesign.trajectory import Trajectory

_ROUNDS = 6  # of a new Z
_ENOUGH = 1e-4  # remaining difference, relative, at which it stops


def evidence_for(design: Design, starts: int, seed: int, executor: Executor | None) -> Design:
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
    columns = [_matrix(problem, design.trajectory)]
    inputs = [design.trajectory.u, *(u for _, u in islice(start_inputs(problem, seed + 1), starts))]
    estimate, best_Z, climbs, better = np.inf, np.eye(len(problem.x0)), 0, design
    for _ in range(_ROUNDS):
        Z = _prices(problem, columns)
        found = _climbed(problem, Z, inputs, executor)
        climbs += len(found)
        usable = [each for each in found if each.status.has_answer and is_feasible(problem, each.path)]
        matrices = [_matrix(problem, each.path) for each in usable]
        largest = max([float(np.sum(Z * W)) for W in [*columns, *matrices]])
        if largest < estimate:
            estimate, best_Z = largest, Z
        better = _improved(better, usable)
        columns += matrices
        inputs = [*(each.u for each in usable), *inputs][: starts + 1]
        if estimate <= better.value * (1 + _ENOUGH):
            break
    remaining = float(max(0.0, 1 - better.value / estimate))
    words = (
        f"{climbs} climbs along <Z, S W S> found no path with a bound below {estimate:.6g}: as far as they tell, no path is better by more "
        f"than {remaining:.2%}. Evidence, not proof."
    )
    return replace(better, evidence=Evidence(estimate, remaining, best_Z, climbs, words))


def _matrix(problem: DesignProblem, path: Trajectory) -> np.ndarray:
    return problem.scaled(problem.judged(path) + np.asarray(problem.known))


def _prices(problem: DesignProblem, columns: Sequence[np.ndarray]) -> np.ndarray:
    """Z >= 0, trace 1 over the judged states, that makes the largest <Z, W> of the columns least: the dual of mixing them."""
    import cvxpy as cp  # seconds to load, and few designs ask

    n, size = len(problem.x0), float(np.mean([np.trace(W) for W in columns]))
    Z, top = cp.Variable((n, n), PSD=True), cp.Variable()
    E = np.zeros((n, n))
    E[problem.judged_states, problem.judged_states] = 1.0
    rows: list[Any] = [cp.sum(cp.multiply(W / size, Z)) <= top for W in columns]
    fixed: Any = cp.sum(cp.multiply(E, Z)) == 1
    cp.Problem(cp.Minimize(top), [*rows, fixed]).solve(solver=cp.CLARABEL)
    found = np.asarray(Z.value)
    values, vectors = np.linalg.eigh((found + found.T) / 2)
    found = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return found / float(np.sum(found * E))


def _climbed(problem: DesignProblem, Z: np.ndarray, inputs: Sequence[np.ndarray], executor: Executor | None) -> list[Climbed]:
    apply = map if executor is None else executor.map
    families = families_of(problem.path)
    return list(apply(climbed, [Task(problem, "dual", u, (families[0], problem.path), True, Linear(Z)) for u in inputs]))


def _improved(design: Design, found: Sequence[Climbed]) -> Design:
    """Climb from the best of the paths found where it promises more than the design."""
    problem = design.problem
    if not found:
        return design
    best = max(found, key=lambda each: objective_of(problem, each.path))
    again = climbed(Task(problem, "from the dual question", best.u, (problem.path,), True))
    if not again.status.has_answer or not is_feasible(problem, again.path):
        return design
    value = objective_of(problem, again.path)
    if value <= design.objective * (1 + 1e-6):
        return design
    fresh = chosen(problem, [again], [again])
    return replace(fresh, starts=(*design.starts, *fresh.starts), optima=(*fresh.optima, *design.optima))
