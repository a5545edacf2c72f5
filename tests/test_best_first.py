"""Branch and bound by the most promising parts, each with a dual of its own: against all schedules, and its derivatives."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from test_selection_cuts import CASES, Case

import obsdesign as od
from obsdesign.conic import svec
from obsdesign.selection.build import build_problem
from obsdesign.selection.integer.best_first_search import continue_best_first, search_best_first, supports_best_first
from obsdesign.selection.integer.reduced_problem import ReducedProblem, reduce_problem
from obsdesign.selection.integer.rounding import purify
from obsdesign.selection.integer.search import Clock, Incumbent, SelectionOptions, find_incumbent
from obsdesign.selection.integer.smoothed_dual import SmoothedDual, branch_decreases, descend, evaluate_duals, quadratic_models, smooth_dual
from obsdesign.selection.problem import SelectionProblem
from obsdesign.selection.relaxation.column_generation import RelaxedSolution, solve_relaxation

NEVER = Clock(0.0, np.inf)


def random_blocks(K: int, S: int, n: int, seed: int) -> np.ndarray:
    factors = np.random.default_rng(seed).standard_normal((K, S, n, 1))
    return factors @ factors.swapaxes(2, 3)


def relaxed_with_all(instance: SelectionProblem) -> tuple[RelaxedSolution, ReducedProblem]:
    """The relaxation, and all schedules as walks."""
    found, walks = solve_relaxation(instance, 1e-9), reduce_problem(instance, [], -np.inf)
    assert found is not None
    assert walks is not None
    return found, walks


def from_nothing(instance: SelectionProblem, gap: float = 1e-9) -> tuple[float, float, bool]:
    """Value, bound and whether it was done, without a schedule to begin with."""
    found, walks = relaxed_with_all(instance)
    nothing = np.zeros(instance.shape, dtype=bool)
    result = search_best_first(instance, walks, found, (nothing, instance.value(nothing)), gap, lambda: False)
    assert instance.is_within_limits(result.chosen)
    assert result.value == instance.value(result.chosen)
    return result.value, result.bound, result.is_complete


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_it_finds_the_best_of_all_schedules_and_proves_it(case: Case):
    value, bound, complete = from_nothing(case.posed())
    best = case.best()
    assert complete
    assert value == pytest.approx(best, rel=1e-9)
    assert best * (1 - 1e-12) <= bound <= best * (1 + 1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_two_at_a_time_of_which_any_one_may_be_lost(seed: int):
    """min over the lost sensor of lambda_min, by all 7^4 schedules of at most two of three."""
    blocks = np.random.default_rng(seed).standard_normal((4, 3, 2, 2))
    blocks = blocks @ blocks.swapaxes(2, 3)
    value, bound, complete = from_nothing(build_problem(blocks, 2, (), od.MinEigenvalue(), 1, None))
    patterns = np.array([each for each in product((0, 1), repeat=3) if sum(each) <= 2])
    chosen = patterns[np.array(list(product(range(len(patterns)), repeat=4)))]
    W = np.stack([np.einsum("aks,ksij->aij", chosen * (np.arange(3) != lost), blocks) for lost in range(3)], axis=1)
    best = np.linalg.eigvalsh(W)[..., 0].min(axis=1).max()
    assert complete
    assert value == pytest.approx(best, rel=1e-9)
    assert best * (1 - 1e-12) <= bound <= best * (1 + 1e-8)


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 2, 3, 4))])
def test_random_blocks_of_rank_1_are_closed_to_their_bar(seed: int):
    """50 segments, one of four sensors, five states: 1.3 %, where the root leaves 2 to 4 %; the value again, and above the drawn ones."""
    blocks = random_blocks(50, 4, 5, seed)
    instance = build_problem(blocks, 1, (), od.MinEigenvalue(), 0, None)
    found = solve_relaxation(instance, 1e-9)
    assert found is not None
    wanted = SelectionOptions("auto", 0.012, None, 0)
    before = find_incumbent(instance, found, purify(instance, found), wanted, NEVER)
    assert 1 - before.value / before.bound > 0.02
    after = continue_best_first(instance, found, before, wanted, NEVER)
    assert np.linalg.eigvalsh(np.einsum("ks,ksij->ij", after.chosen, blocks))[0] == pytest.approx(after.value, rel=1e-12)
    assert before.value < after.value <= after.bound <= after.value / (1 - 0.0125)


def test_time_that_is_up_leaves_what_is_there():
    instance = CASES["rank 1"].posed()
    found, _ = relaxed_with_all(instance)
    nothing = np.zeros(instance.shape, dtype=bool)
    after = continue_best_first(
        instance, found, Incumbent(nothing, 0.0, found.bound), SelectionOptions("auto", 1e-9, 1.0, 0), Clock(0.0, 0.0)
    )
    assert (after.value, after.bound, after.nodes) == (0.0, found.bound, 0)


def test_it_serves_a_smallest_eigenvalue_of_separate_segments():
    blocks = random_blocks(4, 2, 2, 0)
    assert supports_best_first(build_problem(blocks, 1, (), od.MinEigenvalue(), 1, None))
    assert not supports_best_first(build_problem(blocks, 1, (), od.LogDet(), 0, None))
    assert not supports_best_first(build_problem(blocks, 1, (od.MinimumDwell(2),), od.MinEigenvalue(), 0, None))


# ---------------------------------------------------------------- the smoothed dual


def posed_dual(seed: int) -> tuple[SmoothedDual, np.ndarray, np.ndarray, np.ndarray]:
    """Two scenarios of loss and a budget: the dual, random points y (N, c), what is allowed, and the values of all schedules."""
    random, blocks = np.random.default_rng(seed), random_blocks(4, 2, 2, seed)
    rule = od.EnergyBudget(6.0, {0: 2.0, 1: 1.0})
    instance = build_problem(blocks, 2, (rule,), od.MinEigenvalue(), 1, None)
    found, walks = relaxed_with_all(instance)
    problem = smooth_dual(instance, walks, found.bound).with_tau(0.3)
    roots = random.standard_normal((6, 2, 2, 2))
    Z = svec(roots @ roots.swapaxes(2, 3) + 0.1 * np.eye(2)).reshape(6, -1)
    y = np.concatenate([Z, random.uniform(0.01, 1.0, (6, 1))], axis=1)
    chosen = np.array(list(product((0, 1), repeat=8)), dtype=bool).reshape(-1, 4, 2)
    values = np.array([instance.value(each) for each in chosen if instance.is_within_limits(each)]) / found.bound
    return problem, y / (y @ problem.e)[:, None], np.repeat(problem.exists[None], 6, axis=0), values


@pytest.mark.parametrize("seed", range(3))
def test_every_dual_bounds_every_schedule_and_descents_lower_it(seed: int):
    problem, y, allowed, values = posed_dual(seed)
    before = evaluate_duals(problem, y, allowed)
    assert (before.bound >= values.max() * (1 - 1e-12)).all()
    lowest = before.bound
    for tau in (0.3, 0.1, 0.03, 0.01, 0.003):
        after = descend(problem.with_tau(tau), y, allowed, 40, -np.inf)
        y, lowest = after.end.y, np.minimum(lowest, after.bound)
        assert (after.bound >= values.max() * (1 - 1e-12)).all()
    # the relaxation's bound is 1; log-sum-exp of 4 steps in 4 layers, four eigenvalues and a price add tau (4 log 4 + 5) at most
    assert (lowest <= 1 + 0.003 * (4 * np.log(4) + 5)).all()


def test_slope_and_curvature_are_those_of_differences():
    problem, y, allowed, _ = posed_dual(0)
    here = quadratic_models(problem, evaluate_duals(problem, y, allowed))
    H = here.H / here.size[:, :, None] / here.size[:, None, :]
    for i, step in enumerate(1e-6 * np.eye(y.shape[1])):
        ahead, behind = (evaluate_duals(problem, y + sign * step, allowed) for sign in (1.0, -1.0))
        np.testing.assert_allclose((ahead.f - behind.f) / 2e-6, here.gradient[:, i], rtol=1e-6, atol=1e-7)
        bend = (quadratic_models(problem, ahead).gradient - quadratic_models(problem, behind).gradient) / 2e-6
        np.testing.assert_allclose(bend, H[:, i], rtol=1e-5, atol=1e-5 * np.abs(H).max())


def test_a_fall_is_that_of_the_quadratic_model():
    """Fixing a step lowers f by -tau log share at once, and half the square of Newton's step after: close for steps that move little."""
    problem, y, allowed, _ = posed_dual(1)
    calm = SmoothedDual(problem.increments * 1e-3, problem.exists, problem.base, problem.e, problem.sizes, problem.scenarios, 0.3)
    before = descend(calm, y, allowed, 60, -np.inf).end
    falls = branch_decreases(calm, before, allowed)
    for step in range(int(problem.exists[0].sum())):
        fixed = allowed.copy()
        fixed[:, 0] = np.arange(allowed.shape[2]) == step
        after = descend(calm, before.y, fixed, 60, -np.inf).end
        np.testing.assert_allclose(before.f - after.f, falls[:, 0, step], rtol=1e-2)
