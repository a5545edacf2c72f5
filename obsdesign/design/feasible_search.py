"""A path that keeps all limits, whatever it is worth: looked for among many, by working on those that miss least."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from obsdesign.design.blas_threads import one_thread
from obsdesign.design.candidate_inputs import parameters_of, random_parameters, structured
from obsdesign.design.constraint_repair import repaired
from obsdesign.design.feasibility import ALLOWED, shortfalls
from obsdesign.design.nlp.constraint_rows import rows_of, tightened, window_of
from obsdesign.design.nlp.node_functions import nodes_of
from obsdesign.design.nlp.program import Program
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.matrix_objective import nothing
from obsdesign.design.sqp.trust_region_sqp import FEASIBLE, Limits, climb
from obsdesign.dynamics.simulation import simulate, states_from
from obsdesign.trajectory import Trajectory

# random paths that are looked at, and how many of all so far are worked on, round by round
_LOOKED_AT, _WORKED_ON = (100, 300, 900), (8, 12, 24)
_STATES = 40_000  # at once at most
_NEAR = 1e-2  # shortfall from which a path is worked on to the end
_ROUNDS = 6  # of asking for what is missed between the nodes
_ITERATIONS = 40  # of the last climb, which has limits alone to satisfy
_CLIMBING, _HOPELESS = 4, 5.0  # nearest starts that climb in the end, and the shortfall of one that does not
_APART = 0.05  # share of the box by which paths that are worked on must differ


@dataclass(frozen=True, eq=False)
class Sought:
    """The path of least shortfall that was found, margin < 0 where it breaks a limit, and how many starts were worked on."""

    path: Trajectory
    p: np.ndarray
    margin: float
    starts: int

    @property
    def keeps_all(self) -> bool:
        """Whether the path breaks no limit."""
        return self.margin >= 0


def sought(problem: DesignProblem, seed: int, known: tuple[np.ndarray, ...] = (), most: int | None = None) -> Sought:
    """Return a path that breaks no limit, the first that is found, or the one that came nearest to that.

    known: input histories (N, m) that are tried before all others; most: starts that are worked on at most, None = 44 and those.
    Every start is moved to where the squares of what it misses are least, then, if that is little, by a climb that has limits
    alone to satisfy; where no start comes that near, the few nearest climb too. A stationary point of what is missed ends its start only.
    """
    reached: list[Sought] = []
    with one_thread():
        for p in islice(_promising(problem, seed, known), most):
            reached.append(_worked_on(problem, p, _NEAR))
            if reached[-1].keeps_all:
                return replace(reached[-1], starts=len(reached))
        reached.sort(key=lambda each: -each.margin)
        for each in reached[: _CLIMBING if most is None else 0]:
            if each.margin < -_HOPELESS:
                break
            reached.insert(0, _worked_on(problem, each.p, np.inf))
            if reached[0].keeps_all:
                break
    best = max(reached, key=lambda each: each.margin)
    return replace(best, starts=len(reached))


def _promising(problem: DesignProblem, seed: int, known: tuple[np.ndarray, ...]) -> Iterator[np.ndarray]:
    """Yield parameters (q,) worth working on: after those that are known the best of ever more candidates, all of which differ."""
    lower, upper = problem.path.box(problem.grid)
    width, random, done = upper - lower, np.random.default_rng([seed, 6]), []
    for u in known:
        done.append(parameters_of(problem, iter([u]))[0])
        yield done[-1]
    every = parameters_of(problem, structured(problem, seed))
    missed = _missed(problem, every)
    for looked_at, worked_on in zip(_LOOKED_AT, _WORKED_ON, strict=True):
        more = random_parameters(problem, looked_at, random)
        every, missed = np.vstack([every, more]), np.vstack([missed, _missed(problem, more)])
        if _hopeless(missed):
            yield every[int(missed.sum(axis=1).argmin())]
            return
        ways = [np.argsort(score, kind="stable") for score in (missed.sum(axis=1), np.log1p(missed / 1e-3).sum(axis=1))]
        chosen = 0
        for i in (int(i) for pair in zip(*ways, strict=True) for i in pair):
            if all(np.abs(every[i] - other).max() > _APART * width.max() for other in done) or not missed[i].any():
                done.append(every[i])
                yield every[i]
                chosen += 1
            if chosen == worked_on:
                break


def _hopeless(missed: np.ndarray) -> bool:
    """Whether something is missed by the same amount on all paths, whatever they do: what they do does not change it."""
    least, most = missed.min(axis=0), missed.max(axis=0)
    return bool(((least > ALLOWED) & (most - least <= 1e-9 * most)).any())


def _missed(problem: DesignProblem, every: np.ndarray) -> np.ndarray:
    """By how much the paths of parameters (R, q) miss each constraint and budget (R, .), looked at where they have nodes."""
    grid, constraints = problem.grid, problem.constraints
    costs = tuple(budget.cost for budget in problem.budgets)
    if not constraints and not costs:
        return np.zeros((len(every), 1))
    functions, owner = nodes_of(problem.system.model, constraints, costs, (problem.step, problem.substeps)), None
    owner, found = np.array(functions.owner), []
    size = max(1, _STATES // (grid.steps + 1))
    for first in range(0, len(every), size):
        u = np.array([_inputs(problem, p) for p in every[first : first + size]])
        x = states_from(problem.system, np.tile(problem.x0, (len(u), 1)), u, problem.step, substeps=problem.substeps)
        ends = np.concatenate([u, u[:, -1:]], axis=1)
        values = functions.values(x.reshape(-1, x.shape[2]), ends.reshape(-1, ends.shape[2])).reshape(*x.shape[:2], -1)
        found.append(np.column_stack([*_by_constraint(problem, values, owner), *_by_budget(problem, values, functions.margins)]))
    return np.nan_to_num(np.vstack(found), nan=np.inf, posinf=1e300)


def _by_constraint(problem: DesignProblem, values: np.ndarray, owner: np.ndarray) -> list[np.ndarray]:
    t, found = np.arange(values.shape[1]) * problem.step, []
    for i, constraint in enumerate(problem.constraints):
        first, last = window_of(constraint, t[-1])
        within = (t >= first - 0.5 * problem.step) & (t <= last + 0.5 * problem.step)
        least = values[:, within][:, :, owner == i].min(axis=2, initial=np.inf)
        found.append(np.maximum(0.0, -(least.max(axis=1) if constraint.span.anywhere else least.min(axis=1))))
    return found


def _by_budget(problem: DesignProblem, values: np.ndarray, margins: int) -> list[np.ndarray]:
    totals = values[:, :-1, margins:].sum(axis=1) * problem.step
    return [np.maximum(0.0, total / budget.at_most - 1) for budget, total in zip(problem.budgets, totals.T, strict=True)]


def _worked_on(problem: DesignProblem, p: np.ndarray, near: float) -> Sought:
    """Move parameters to where limits are kept, as far as one start leads; near: the shortfall from which it climbs, too."""
    rows, margin, path = rows_of(problem), -np.inf, None
    for _ in range(_ROUNDS):
        program = Program(problem, rows, judged=False)
        reached = repaired(program, p, FEASIBLE)
        p = reached.p
        if FEASIBLE < reached.violation <= near or (problem.floor is not None and reached.violation <= near):
            limits = Limits(iterations=_ITERATIONS)
            p = climb(program, nothing(len(problem.x0)), p, limits=limits).p
        path, margin = _judged(problem, p)
        following = None if margin >= 0 else tightened(problem, path, rows)
        if following is None or reached.violation > near:
            break
        rows = following
    if path is None:
        raise AssertionError("there is a round")
    return Sought(path, p, margin, 1)


def _inputs(problem: DesignProblem, p: np.ndarray) -> np.ndarray:
    """Inputs (N, m) of parameters (q,)."""
    u: Any = problem.path.inputs(p, problem.grid)  # pyright: ignore[reportArgumentType]  # serves both kinds
    return np.asarray(u, dtype=float).reshape(problem.steps, -1)


def _judged(problem: DesignProblem, p: np.ndarray) -> tuple[Trajectory, float]:
    """The path of parameters, and its least margin where that is below 0; 0 where all limits are kept."""
    path = simulate(problem.system, problem.x0, _inputs(problem, p), problem.step, tolerance=problem.tolerance)
    return path, min((each.margin for each in shortfalls(problem, path)), default=0.0)
