"""A path that keeps all limits, whatever it is worth: looked for among many, by working on those that miss least."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from obsdesign.blas_threads import one_thread
from obsdesign.design.candidate_inputs import heuristic_inputs, parameters_of, random_parameters
from obsdesign.design.constraint_repair import repair
from obsdesign.design.feasibility import MARGIN_TOLERANCE, violations
from obsdesign.design.nlp.constraint_rows import initial_rows, tighten, time_window
from obsdesign.design.nlp.node_functions import node_functions_of
from obsdesign.design.nlp.program import Program
from obsdesign.design.problem import DesignProblem
from obsdesign.design.sqp.local_model import FEASIBILITY_TOLERANCE
from obsdesign.design.sqp.matrix_objective import zero_objective
from obsdesign.design.sqp.trust_region_sqp import StoppingCriteria, solve
from obsdesign.dynamics.simulation import states_from
from obsdesign.trajectory import Trajectory

# random paths that are looked at, and how many of all so far are worked on, round by round
_CANDIDATES, _REPAIRS = (100, 300, 900), (8, 12, 24)
_MAX_STATES = 40_000  # at once at most
_REPAIR_LIMIT = 1e-2  # shortfall from which a path is worked on to the end
_ROUNDS = 6  # of asking for what is missed between the nodes
_ITERATIONS = 40  # of the last climb, which has limits alone to satisfy
_FINAL_SOLVES, _MAX_VIOLATION = 4, 5.0  # nearest starts that climb in the end, and the shortfall of one that does not
_MIN_DISTANCE = 0.05  # share of the box by which paths that are worked on must differ


@dataclass(frozen=True, eq=False)
class FeasibilitySearch:
    """The path of least shortfall that was found, margin < 0 where it breaks a limit, and how many starts were worked on."""

    path: Trajectory
    p: np.ndarray
    margin: float
    starts: int

    @property
    def is_feasible(self) -> bool:
        """Whether the path breaks no limit."""
        return self.margin >= 0


def search_feasible_path(
    problem: DesignProblem, seed: int, first_inputs: tuple[np.ndarray, ...] = (), max_starts: int | None = None
) -> FeasibilitySearch:
    """Return a path that breaks no limit, the first that is found, or the one that came nearest to that.

    first_inputs: input histories (N, m) that are tried before all others; max_starts: starts that are worked on at most, None = 44 and
    those. Every start is moved to where the squares of what it misses are least, then, if that is little, by a climb that has limits
    alone to satisfy; where no start comes that near, the few nearest climb too. A stationary point of what is missed ends its start only.
    """
    results: list[FeasibilitySearch] = []
    with one_thread():
        for p in islice(_candidate_parameters(problem, seed, first_inputs), max_starts):
            results.append(_repair_start(problem, p, _REPAIR_LIMIT))
            if results[-1].is_feasible:
                return replace(results[-1], starts=len(results))
        results.sort(key=lambda result: -result.margin)
        for result in results[: _FINAL_SOLVES if max_starts is None else 0]:
            if result.margin < -_MAX_VIOLATION:
                break
            results.insert(0, _repair_start(problem, result.p, np.inf))
            if results[0].is_feasible:
                break
    best = max(results, key=lambda result: result.margin)
    return replace(best, starts=len(results))


def _candidate_parameters(problem: DesignProblem, seed: int, first_inputs: tuple[np.ndarray, ...]) -> Iterator[np.ndarray]:
    """Yield parameters (q,) worth working on: after those that are known the best of ever more candidates, all of which differ."""
    lower, upper = problem.path.box(problem.grid)
    width, random, chosen_parameters = upper - lower, np.random.default_rng([seed, 6]), []
    for u in first_inputs:
        chosen_parameters.append(parameters_of(problem, iter([u]))[0])
        yield chosen_parameters[-1]
    candidates = parameters_of(problem, heuristic_inputs(problem, seed))
    violation_table = _violation_table(problem, candidates)
    for candidate_count, repair_count in zip(_CANDIDATES, _REPAIRS, strict=True):
        random_candidates = random_parameters(problem, candidate_count, random)
        candidates, violation_table = (
            np.vstack([candidates, random_candidates]),
            np.vstack([violation_table, _violation_table(problem, random_candidates)]),
        )
        if _is_path_independent(violation_table):
            yield candidates[int(violation_table.sum(axis=1).argmin())]
            return
        orders = [np.argsort(score, kind="stable") for score in (violation_table.sum(axis=1), np.log1p(violation_table / 1e-3).sum(axis=1))]
        chosen_count = 0
        for i in (int(i) for pair in zip(*orders, strict=True) for i in pair):
            if (
                all(np.abs(candidates[i] - earlier).max() > _MIN_DISTANCE * width.max() for earlier in chosen_parameters)
                or not violation_table[i].any()
            ):
                chosen_parameters.append(candidates[i])
                yield candidates[i]
                chosen_count += 1
            if chosen_count == repair_count:
                break


def _is_path_independent(violation_table: np.ndarray) -> bool:
    """Whether something is missed by the same amount on all paths, whatever they do: what they do does not change it."""
    smallest, largest = violation_table.min(axis=0), violation_table.max(axis=0)
    return bool(((smallest > MARGIN_TOLERANCE) & (largest - smallest <= 1e-9 * largest)).any())


def _violation_table(problem: DesignProblem, parameters: np.ndarray) -> np.ndarray:
    """By how much the paths of parameters (R, q) miss each constraint and budget (R, .), looked at where they have nodes."""
    grid, constraints = problem.grid, problem.constraints
    costs = tuple(budget.cost for budget in problem.budgets)
    if not constraints and not costs:
        return np.zeros((len(parameters), 1))
    functions, batches = node_functions_of(problem.system.model, constraints, costs, (problem.step, problem.substeps)), []
    size = max(1, _MAX_STATES // (grid.steps + 1))
    for first in range(0, len(parameters), size):
        u = np.array([problem.inputs_of(p) for p in parameters[first : first + size]])
        x = states_from(problem.system, np.tile(problem.x0, (len(u), 1)), u, problem.step, substeps=problem.substeps)
        ends = np.concatenate([u, u[:, -1:]], axis=1)
        values = functions.values(x.reshape(-1, x.shape[2]), ends.reshape(-1, ends.shape[2])).reshape(*x.shape[:2], -1)
        batches.append(
            np.column_stack(
                [*_constraint_columns(problem, functions.least(values)), *_budget_columns(problem, values, functions.margin_count)]
            )
        )
    return np.nan_to_num(np.vstack(batches), nan=np.inf, posinf=1e300)


def _constraint_columns(problem: DesignProblem, least_margins: np.ndarray) -> list[np.ndarray]:
    """By how much paths miss each constraint (R,), of its least margins at their nodes (R, N+1, c)."""
    t, columns = np.arange(least_margins.shape[1]) * problem.step, []
    for i, constraint in enumerate(problem.constraints):
        first, last = time_window(constraint, t[-1])
        in_window = (t >= first - 0.5 * problem.step) & (t <= last + 0.5 * problem.step)
        lowest_margin = least_margins[:, in_window, i]
        columns.append(np.maximum(0.0, -(lowest_margin.max(axis=1) if constraint.span.anywhere else lowest_margin.min(axis=1))))
    return columns


def _budget_columns(problem: DesignProblem, values: np.ndarray, margins: int) -> list[np.ndarray]:
    totals = values[:, :-1, margins:].sum(axis=1) * problem.step
    return [np.maximum(0.0, total / budget.at_most - 1) for budget, total in zip(problem.budgets, totals.T, strict=True)]


def _repair_start(problem: DesignProblem, p: np.ndarray, repair_limit: float) -> FeasibilitySearch:
    """Move parameters to where limits are kept, as far as one start leads; repair_limit: the shortfall from which it climbs, too."""
    rows, margin, path = initial_rows(problem), -np.inf, None
    for _ in range(_ROUNDS):
        program = Program(problem, rows, with_information=False)
        repair_result = repair(program, p, FEASIBILITY_TOLERANCE)
        p = repair_result.p
        if FEASIBILITY_TOLERANCE < repair_result.violation <= repair_limit or (
            problem.floor is not None and repair_result.violation <= repair_limit
        ):
            stopping = StoppingCriteria(iterations=_ITERATIONS)
            p = solve(program, zero_objective(len(problem.x0)), p, stopping=stopping).p
        path, margin = _simulate_and_check(problem, p)
        tighter_rows = None if margin >= 0 else tighten(problem, path, rows)
        if tighter_rows is None or repair_result.violation > repair_limit:
            break
        rows = tighter_rows
    if path is None:
        raise AssertionError("there is a round")
    return FeasibilitySearch(path, p, margin, 1)


def _simulate_and_check(problem: DesignProblem, p: np.ndarray) -> tuple[Trajectory, float]:
    """The path of parameters, and its least margin where that is below 0; 0 where all limits are kept."""
    path = problem.path_of(p)
    return path, min((violation.margin for violation in violations(problem, path)), default=0.0)
