"""How much better might another path be: the dual question, asked from several starts."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from itertools import islice

import numpy as np

from obsdesign.design.best_design import chosen, objective_of
from obsdesign.design.feasibility import is_feasible
from obsdesign.design.initial_guesses import start_inputs
from obsdesign.design.local_solve import Climbed, Task, climbed, families_of
from obsdesign.design.problem import DesignProblem
from obsdesign.design.record import Design, Evidence
from obsdesign.design.sqp.conic_qp import Cone, Model, minimised
from obsdesign.design.sqp.matrix_objective import Linear, aim_of
from obsdesign.dynamics.simulation import simulate

_ROUNDS, _CHEAP = 6, 40  # of a new Z; paths that are looked at without a climb
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
    seen = [(design.trajectory.u, problem.matrix(design.trajectory)), *_at_random(problem, seed)]
    tried, climbs, better = [], 0, design
    for _ in range(_ROUNDS):
        Z = _prices(problem, [W for _, W in seen])
        tried.append(Z)
        promising = sorted(seen, key=lambda pair: -float(np.sum(Z * pair[1])))[:starts]  # used at once
        found = _climbed(problem, Z, [u for u, _ in promising], executor)
        climbs += len(found)
        usable = [each for each in found if each.status.has_answer and is_feasible(problem, each.path)]
        seen += [(each.u, problem.matrix(each.path)) for each in usable]
        better = _improved(better, usable)
        if _estimate(tried, seen)[0] <= better.value * (1 + _ENOUGH):
            break
    estimate, best = _estimate(tried, seen)
    remaining = float(max(0.0, 1 - better.value / estimate))
    words = (
        f"{climbs} climbs along <Z, S W S> for {len(tried)} matrices Z met no path above {estimate:.6g} for the best of them: as far as "
        f"they tell, no path is better by more than {remaining:.2%}. Evidence, not proof."
    )
    return replace(better, evidence=Evidence(estimate, remaining, best, climbs, words))


_Seen = tuple[np.ndarray, np.ndarray]  # inputs of a path, and its S W S


def _at_random(problem: DesignProblem, seed: int) -> list[_Seen]:
    """Paths of the shaped and random starts that meet all limits."""
    found = []
    for _, u in islice(start_inputs(problem, seed + 1), _CHEAP):
        p = problem.path.fit(u, problem.grid)
        u_fit = np.array(problem.path.inputs(p, problem.grid), dtype=float).reshape(problem.steps, -1)  # pyright: ignore[reportArgumentType]
        path = simulate(problem.system, problem.x0, u_fit, problem.step, tolerance=problem.tolerance)
        if is_feasible(problem, path):
            found.append((path.u, problem.matrix(path)))
    return found


def _estimate(tried: Sequence[np.ndarray], seen: Sequence[_Seen]) -> tuple[float, np.ndarray]:
    """The least, over all Z tried, of the largest <Z, S W S> of any path seen, and that Z."""
    largest = [max(float(np.sum(Z * W)) for _, W in seen) for Z in tried]
    best = int(np.argmin(largest))
    return largest[best], tried[best]


def _prices(problem: DesignProblem, columns: Sequence[np.ndarray]) -> np.ndarray:
    """Z >= 0, trace 1 over the judged states, that makes the largest <Z, W> of the columns least.

    It is the multiplier of the best mixture: max t with sum_j a_j W_j - t E >= 0, a >= 0, sum a = 1.
    """
    n, size = len(problem.x0), float(np.mean([np.trace(W) for W in columns])) / len(problem.x0)
    E = np.zeros((n, n))
    E[problem.judged_states, problem.judged_states] = 1.0
    last, others = columns[-1] / size, np.array([W / size - columns[-1] / size for W in columns[:-1]]).reshape(-1, n, n)
    count = len(others)
    mixture = Model(
        B=1e-9 * np.eye(count),
        g=np.zeros(count),
        weights=np.ones(1),
        penalty=1e3,
        low=np.zeros(count),
        high=np.ones(count),
        cones=(Cone(last, others, E, 0, 0.0),),
        rows=np.ones(1),
        slopes=-np.ones((1, count)),
        hard=np.zeros(0),
        hard_slopes=np.zeros((0, count)),
    )
    found = minimised(mixture, 1e-9)
    Z = aim_of(problem).slopes(columns[0][None])[0] if found is None else found.Z[0]
    values, vectors = np.linalg.eigh((Z + Z.T) / 2)
    Z = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return Z / float(np.sum(Z * E))


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
