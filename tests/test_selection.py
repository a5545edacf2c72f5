"""Sensor schedules: weak and strong duality, symmetries of the problem, proofs, limits. Against trying all: see test_rules.py too."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from time import perf_counter

import clarabel
import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_rules import CRITERIA, Problem, best, bounded_by_its_dual, certified, feasible, random_blocks

import obsdesign as od
from obsdesign.rules.abstract import AbstractRule
from obsdesign.selection.baselines import random_schedule, round_robin, single_sensor
from obsdesign.selection.build import build_problem
from obsdesign.selection.integer.best_first_search import search_best_first
from obsdesign.selection.integer.reduced_problem import ReducedProblem, reduce_problem
from obsdesign.selection.relaxation.column_generation import solve_relaxation
from obsdesign.selection.schedule import schedule_information

few = settings(deadline=None, max_examples=8, database=None, derandomize=True)
seeds = st.integers(0, 10**6)


def path_blocks(segments: int, samples: int = 1, seed: int = 0) -> np.ndarray:
    """A turning flight near a beacon with GPS, compass, range and bearing, in the prior's units."""
    beacon = (40.0, 25.0)
    sensors = (od.GPS(2.0), od.Magnetometer(0.21), od.Range(beacon, 1.0), od.Bearing(beacon, 0.087))
    system = od.System(od.Dubins(15.0, wind="constant"), sensors)
    t, random = 0.25 * np.arange(segments * samples), np.random.default_rng(seed)
    turn_rate = 0.5 * np.sin(4 * t + random.uniform(0, 6)) + 0.2 * np.sin(0.7 * t)
    path = od.simulate(system, (3.0, -1.0, 0.4, 2.0, -1.0), turn_rate, 0.25)
    units = np.array([20.0, 20.0, 0.3, 3.0, 3.0])
    return od.variational_gramian(system, path).by_segment(segments) * np.outer(units, units)


PROBLEMS = {
    "rank 1": random_blocks(4, 4, 3, 1),
    "rank 1, n 5": random_blocks(5, 3, 5, 1, seed=1),
    "full": random_blocks(8, 2, 3, 3, seed=2),
    "mixed": np.concatenate([random_blocks(4, 2, 4, 1, seed=4), 0.3 * random_blocks(4, 2, 4, 4, seed=5)], axis=1),
    "path": path_blocks(4, 6),
}
every_problem = pytest.mark.parametrize("name", PROBLEMS)
one_or_two = pytest.mark.parametrize("per_segment", [1, 2])
every_criterion = pytest.mark.parametrize("criterion", CRITERIA, ids=lambda each: type(each).__name__)


def optimum(blocks: np.ndarray, per_segment: int) -> float:
    """lambda_min of the best schedule, by trying all."""
    return best(Problem(blocks, per_segment, (), od.MinEigenvalue(), 0))


@cache
def best_value(name: str, per_segment: int) -> float:
    return optimum(PROBLEMS[name], per_segment)


@cache
def selected(name: str, per_segment: int = 1) -> od.Schedule:
    """The selection is a pure function: ask once."""
    return od.select_sensors(PROBLEMS[name], per_segment)


def random_dual(n: int, seed: int) -> np.ndarray:
    """Z >= 0 with trace 1, of random rank."""
    random = np.random.default_rng(seed)
    factor = random.standard_normal((n, random.integers(1, n + 1)))
    return factor @ factor.T / np.sum(factor**2)


# ---------------------------------------------------------------- certificates


@every_problem
@one_or_two
def test_the_best_of_all_schedules_is_found_and_proven(name: str, per_segment: int):
    schedule = selected(name, per_segment)
    assert schedule.status is od.Status.OPTIMAL
    assert schedule.value == pytest.approx(best_value(name, per_segment), rel=1e-9)
    assert schedule.bound >= best_value(name, per_segment) * (1 - 1e-12)


@every_problem
@one_or_two
def test_everything_a_schedule_claims_can_be_recomputed(name: str, per_segment: int):
    blocks, schedule = PROBLEMS[name], selected(name, per_segment)
    assert schedule.chosen.shape == blocks.shape[:2]
    assert schedule.chosen.dtype == bool
    assert schedule.chosen.sum(axis=1).max() <= per_segment
    assert schedule.value == pytest.approx(np.linalg.eigvalsh(blocks[schedule.chosen].sum(axis=0))[0], rel=1e-12)
    assert np.trace(schedule.dual) == pytest.approx(1.0, abs=1e-12)
    assert np.linalg.eigvalsh(schedule.dual)[0] >= -1e-14
    gains = sorted_gains(blocks, schedule.dual)
    assert schedule.root_bound == pytest.approx(gains[:, :per_segment].sum(), rel=1e-12)
    assert schedule.value <= schedule.bound <= schedule.root_bound * (1 + 1e-12)
    assert schedule.gap == pytest.approx(1 - schedule.value / schedule.bound, abs=1e-15)
    assert schedule.offset == 0.0
    assert schedule.prices.shape == (0,)


def sorted_gains(blocks: np.ndarray, Z: np.ndarray) -> np.ndarray:
    """max(tr(W_ks Z), 0), largest first in each segment."""
    gains = [[max(float(np.trace(W @ Z)), 0.0) for W in row] for row in blocks]
    return -np.sort(-np.array(gains), axis=1)


@pytest.mark.parametrize(
    ("Z", "says"),
    [
        (np.eye(3), r"shape \(3, 3\)"),
        (np.diag([1.0, 1.0, 1.0, -1e-6]), "not positive semidefinite"),
        (np.eye(4) + np.eye(4, k=1), "symmetric"),
        (np.zeros((4, 4)), "not 0"),
        (np.full((4, 4), np.nan), "not finite"),
    ],
)
def test_what_is_no_dual_bounds_nothing(Z: np.ndarray, says: str):
    with pytest.raises(od.InputError, match=says):
        od.upper_bound(next(blocks for blocks in PROBLEMS.values() if blocks.shape[2] == 4), Z)


def test_a_bound_does_not_depend_on_the_scale_of_its_dual():
    blocks = next(iter(PROBLEMS.values()))
    Z = random_dual(blocks.shape[2], 1)
    assert od.upper_bound(blocks, 1e-6 * Z) == pytest.approx(od.upper_bound(blocks, Z), rel=1e-12)


@every_problem
@one_or_two
@few
@given(seed=seeds)
def test_every_z_bounds_every_schedule(name: str, per_segment: int, seed: int):
    """Weak duality: lambda_min(W) <= <W, Z> for Z >= 0, tr Z = 1."""
    blocks = PROBLEMS[name]
    Z = random_dual(blocks.shape[2], seed)
    bound = od.upper_bound(blocks, Z, per_segment)
    assert bound == pytest.approx(sorted_gains(blocks, Z)[:, :per_segment].sum(), rel=1e-12)
    assert bound >= best_value(name, per_segment) * (1 - 1e-12)
    # and it is attained in the direction of Z
    gains = np.einsum("ksij,ij->ks", blocks, Z)
    chosen = gains >= np.sort(gains, axis=1)[:, -per_segment][:, None]
    assert np.sum(schedule_information(blocks, chosen) * Z) == pytest.approx(bound, rel=1e-12)
    assert np.linalg.eigvalsh(schedule_information(blocks, chosen))[0] <= bound


@every_problem
@one_or_two
def test_the_bound_is_the_optimum_of_the_relaxation(name: str, per_segment: int):
    """Strong duality, with the relaxation written down afresh."""
    blocks = PROBLEMS[name]
    weights = [cp.Variable(blocks.shape[1], nonneg=True) for _ in blocks]
    total = sum(row[s] * W[s] for row, W in zip(weights, blocks, strict=True) for s in range(len(W)))
    limits = [limit for row in weights for limit in (row <= 1, cp.sum(row) <= per_segment)]
    relaxation = cp.Problem(cp.Maximize(cp.lambda_min(total)), limits)
    relaxation.solve(solver=cp.CLARABEL)
    assert selected(name, per_segment).root_bound == pytest.approx(relaxation.value, rel=1e-6)


def test_no_z_gives_a_bound_below_the_one_that_is_returned():
    blocks, schedule = PROBLEMS["mixed"], selected("mixed")
    others = [od.upper_bound(blocks, 0.9 * schedule.dual + 0.1 * random_dual(4, seed)) for seed in range(50)]
    assert min(others) >= schedule.root_bound * (1 - 1e-7)


@pytest.mark.parametrize(("name", "criterion"), [(name, CRITERIA[i % 3]) for i, name in enumerate(PROBLEMS)])
@pytest.mark.parametrize("gap", [0.3, 0.02])
def test_a_gap_that_is_asked_for_ends_the_search_and_is_honest(name: str, criterion: object, gap: float):
    problem = Problem(PROBLEMS[name], 1, (), criterion, 0)  # pyright: ignore[reportArgumentType]
    schedule, most = problem.solved(gap=gap), best(problem)
    size = 1.0 if isinstance(criterion, od.LogDet) else abs(schedule.bound)
    assert schedule.status is od.Status.OPTIMAL
    assert schedule.gap <= gap
    assert schedule.bound - schedule.value == pytest.approx(schedule.gap * size, abs=1e-12 * size)
    assert schedule.value <= most + 1e-9 * size
    assert schedule.bound >= most - 1e-9 * size


@every_problem
@pytest.mark.parametrize("share", [0.99, 1.01])
def test_optimal_is_said_only_where_the_gap_is_closed(name: str, share: float):
    """Asked without a proof for a little less and a little more than the gap that is reached."""
    gap = share * od.select_sensors(PROBLEMS[name], method="columns").gap
    schedule = od.select_sensors(PROBLEMS[name], gap=gap, method="columns")
    assert (schedule.status is od.Status.OPTIMAL) == (schedule.gap <= gap)
    assert schedule.status in (od.Status.OPTIMAL, od.Status.GAP_OPEN)


def test_a_choice_without_alternative_is_proven_optimal():
    """One sensor, or all sensors on: value = bound."""
    blocks = PROBLEMS["full"]
    for candidates, per_segment in ((blocks[:, :1], 1), (blocks, 2)):
        schedule = od.select_sensors(candidates, per_segment, gap=1e-6)
        assert schedule.status is od.Status.OPTIMAL
        assert schedule.chosen.all()


def test_the_gap_closes_where_the_relaxation_is_integer():
    """Sensor 0 dominates: W_k0 >= W_k1 everywhere, so one schedule is best for every Z."""
    blocks = random_blocks(6, 1, 3, 3)
    schedule = od.select_sensors(np.concatenate([blocks, 0.5 * blocks], axis=1), gap=1e-6)
    assert schedule.status is od.Status.OPTIMAL
    np.testing.assert_array_equal(schedule.chosen, single_sensor(6, 2, 0))


def test_with_one_state_the_answer_is_the_largest_of_each_segment():
    blocks = np.random.default_rng(0).uniform(0, 1, (20, 5, 1, 1))
    schedule = od.select_sensors(blocks, per_segment=2)
    expected = np.sort(blocks[:, :, 0, 0], axis=1)[:, -2:].sum()
    assert schedule.value == pytest.approx(expected, rel=1e-12)
    assert schedule.bound == pytest.approx(expected, rel=1e-12)


def test_where_a_state_stays_hidden_the_value_is_zero_and_the_bound_says_so():
    """No sensor sees the second state: lambda_min = 0 for every schedule, and Z = e_2 e_2' proves it."""
    blocks = np.zeros((3, 2, 2, 2))
    blocks[:, 0, 0, 0], blocks[:, 1, 0, 0] = 1.0, 2.0
    schedule = od.select_sensors(blocks)
    assert schedule.value == 0.0
    assert 0.0 <= schedule.bound < 1e-6


# ---------------------------------------------------------------- symmetries


@pytest.mark.parametrize(("name", "factor"), [("rank 1", 1e-6), ("mixed", 3e9), ("path", 1e-6), ("path", 3e9)])
def test_scaling_the_blocks_scales_value_and_bound(name: str, factor: float):
    plain, scaled = selected(name), od.select_sensors(factor * PROBLEMS[name])
    np.testing.assert_array_equal(plain.chosen, scaled.chosen)
    assert scaled.value == pytest.approx(factor * plain.value, rel=1e-9)
    assert scaled.bound == pytest.approx(factor * plain.bound, rel=1e-6)


@pytest.mark.parametrize("name", ["rank 1", "full", "path"])
@pytest.mark.parametrize("seed", [1])
def test_the_order_of_segments_and_sensors_does_not_matter(name: str, seed: int):
    """The bound is unique; the value is, because brute force finds the same optimum."""
    blocks, random = PROBLEMS[name], np.random.default_rng(seed)
    segments, sensors = random.permutation(blocks.shape[0]), random.permutation(blocks.shape[1])
    plain, shuffled = selected(name), od.select_sensors(blocks[segments][:, sensors])
    assert shuffled.root_bound == pytest.approx(plain.root_bound, rel=1e-6)
    assert shuffled.value == pytest.approx(plain.value, rel=1e-9)
    np.testing.assert_array_equal(shuffled.chosen, plain.chosen[segments][:, sensors])


@pytest.mark.parametrize("name", ["rank 1", "full", "path"])
def test_an_orthogonal_change_of_state_does_not_matter(name: str):
    blocks = PROBLEMS[name]
    Q = np.linalg.qr(np.random.default_rng(8).standard_normal(blocks.shape[2:]))[0]
    plain, turned = selected(name), od.select_sensors(Q.T @ blocks @ Q)
    assert turned.root_bound == pytest.approx(plain.root_bound, rel=1e-6)
    assert turned.value == pytest.approx(plain.value, rel=1e-9)


@pytest.mark.parametrize("name", ["mixed", "path"])
@pytest.mark.parametrize("decades", [4, 10])
def test_very_different_units_leave_the_certificate_valid_and_tight(name: str, decades: int):
    n = PROBLEMS[name].shape[2]
    units = 10.0 ** np.random.default_rng(0).uniform(-decades / 2, decades / 2, n)
    scaled = PROBLEMS[name] * np.outer(units, units)
    schedule, best = od.select_sensors(scaled), optimum(scaled, 1)
    # eigenvalues carry a rounding error of the largest one: with ten decades of units it may be larger than the smallest
    rounding = 1e-14 * np.abs(scaled.sum(axis=(0, 1))).max()
    assert rounding < 1e-3 * best or decades == 10
    assert schedule.bound >= schedule.value
    assert schedule.bound >= best - rounding
    assert schedule.value <= best + rounding
    assert schedule.root_bound == pytest.approx(max(od.upper_bound(scaled, schedule.dual), schedule.value), rel=1e-12)
    # no other Z does better: neither a single state nor a mixture
    others = [np.diag(unit) for unit in np.eye(n)] + [random_dual(n, k) for k in range(20)]
    assert schedule.root_bound <= min(od.upper_bound(scaled, Z) for Z in others) * (1 + 1e-6) + rounding


@one_or_two
def test_the_same_blocks_and_seed_give_the_same_bytes(per_segment: int):
    first, second = (od.select_sensors(PROBLEMS["mixed"], per_segment) for _ in range(2))
    assert first.chosen.tobytes() == second.chosen.tobytes()
    assert (first.value, first.bound, first.gap) == (second.value, second.bound, second.gap)
    assert first.dual.tobytes() == second.dual.tobytes()


@pytest.mark.parametrize("name", ["rank 1, n 5", "full", "path"])
@pytest.mark.parametrize("seed", [1])
def test_any_change_of_state_moves_a_log_determinant_by_a_constant(name: str, seed: int):
    """log det(T' W T) = log det W + 2 log |det T|."""
    blocks = PROBLEMS[name]
    T = np.random.default_rng(seed).standard_normal(blocks.shape[2:]) + 2 * np.eye(blocks.shape[2])
    plain, turned = (od.select_sensors(each, criterion=od.LogDet()) for each in (blocks, T.T @ blocks @ T))
    moved = 2 * np.linalg.slogdet(T)[1]
    assert turned.value == pytest.approx(plain.value + moved, abs=1e-8)
    assert turned.root_bound == pytest.approx(plain.root_bound + moved, abs=1e-6)


@every_criterion
@pytest.mark.parametrize("factor", [1e5])
def test_a_factor_is_all_that_scaling_changes(criterion: object, factor: float):
    """lambda_min times c, log det plus n log c, -tr W^-1 over c: rules and losses or not."""
    rules = (od.EnergyBudget(7.0, {0: 1.0, 1: 2.0, 2: 3.0}), od.MinimumDwell(2, (1,)))
    plain = Problem(random_blocks(5, 3, 2, 2, seed=3), 2, rules, criterion, 1)  # pyright: ignore[reportArgumentType]
    one, other = plain.solved(), replace(plain, blocks=factor * plain.blocks).solved()
    expected = {
        "MinEigenvalue": factor * one.value,
        "LogDet": one.value + 2 * np.log(factor),
        "TraceInverse": one.value / factor,
    }[type(criterion).__name__]
    assert other.status is one.status is od.Status.OPTIMAL
    assert other.value == pytest.approx(expected, rel=1e-8, abs=1e-8 if isinstance(criterion, od.LogDet) else 0)


# ---------------------------------------------------------------- fractions, methods, losses


@pytest.mark.parametrize(("segments", "count"), [(5, 4), (12, 4), (40, 2), pytest.param(300, 1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["path", "random"])
def test_a_vertex_of_the_relaxation_has_few_undecided_segments(segments: int, count: int, kind: str):
    """At most n (n + 1) / 2 - 1, whatever K is, and one more for each budget."""
    for seed in range(count):
        n = 5 if kind == "path" else 1 + seed % 5
        blocks = path_blocks(segments, 2, seed) if kind == "path" else random_blocks(segments, 4, n, 1 + seed % n, seed)
        for per_segment, rules in ((1, ()), (2, ()), (1, (od.EnergyBudget(0.9 * segments, {0: 1.0, 1: 0.3, 2: 1.7, 3: 2.0}),))):
            schedule = od.select_sensors(blocks, per_segment, rules=rules, method="columns")
            assert schedule.fractional <= n * (n + 1) // 2 - 1 + len(rules)


@pytest.mark.parametrize("name", ["mixed", "path"])
@every_criterion
def test_two_ways_to_the_relaxation_agree(name: str, criterion: object):
    problem = Problem(PROBLEMS[name], 2, (), criterion, 0)  # pyright: ignore[reportArgumentType]
    columns, direct = (problem.solved(method=method) for method in ("columns", "direct"))
    size = 1.0 if isinstance(criterion, od.LogDet) else abs(columns.root_bound)
    # along a path, Clarabel ends early with a criterion that is no eigenvalue: its bound is weaker, never wrong
    early = name == "path" and not isinstance(criterion, od.MinEigenvalue)
    assert columns.root_bound <= direct.root_bound + 1e-5 * size
    assert direct.root_bound <= columns.root_bound + (1e-2 if early else 1e-5) * size
    assert not direct.notes
    for schedule in (columns, direct):
        certified(problem, schedule, schedule.status.value)
        bounded_by_its_dual(problem, schedule, schedule.status.value)


@pytest.mark.parametrize("rules", [(), (od.EnergyBudget(30.0, {0: 1.0, 1: 2.0}),)], ids=["free", "budget"])
def test_two_ways_to_the_relaxation_agree_with_budgets_and_losses(rules: tuple[od.EnergyBudget, ...]):
    problem = Problem(path_blocks(16, 2), 3, rules, od.MinEigenvalue(), 1)
    columns, direct = (problem.solved(method=method) for method in ("columns", "direct"))
    assert direct.root_bound == pytest.approx(columns.root_bound, rel=1e-5)
    assert max(columns.value, direct.value) <= min(columns.bound, direct.bound)


@pytest.mark.parametrize("name", ["rank 1", "path"])
@every_criterion
def test_a_robust_schedule_is_the_best_for_the_worst_loss_and_no_better_than_a_plain_one(name: str, criterion: object):
    plain, robust = (Problem(PROBLEMS[name], 2, (), criterion, lost) for lost in (0, 1))  # pyright: ignore[reportArgumentType]
    without, schedule = plain.solved(), robust.solved()
    size = 1.0 if isinstance(criterion, od.LogDet) else abs(without.value)
    assert schedule.value == pytest.approx(best(robust), rel=1e-8, abs=1e-8 if isinstance(criterion, od.LogDet) else 1e-10)
    assert schedule.value <= without.value + 1e-12 * size
    assert schedule.bound <= without.bound + 1e-6 * size


# ---------------------------------------------------------------- proofs and limits


@pytest.mark.parametrize("seed", [0, 1])
def test_twenty_segments_of_a_path_are_proven(seed: int):
    blocks = path_blocks(20, 4, seed)
    schedule = od.select_sensors(blocks)
    assert schedule.status is od.Status.OPTIMAL
    assert schedule.gap <= 1e-9
    assert schedule.value == pytest.approx(np.linalg.eigvalsh(blocks[schedule.chosen].sum(axis=0))[0], rel=1e-12)
    # nothing that changes one or two segments is better, and no schedule drawn at random
    random = np.random.default_rng(seed)
    for _ in range(2000):
        other = schedule.chosen.copy()
        for k in random.integers(20, size=random.integers(1, 4)):
            other[k] = np.arange(4) == random.integers(4)
        assert np.linalg.eigvalsh(schedule_information(blocks, other))[0] <= schedule.value * (1 + 1e-9)


@pytest.mark.parametrize("time_limit", [1e-9, 0.3])
@pytest.mark.parametrize("robust_to", [0, 1])
def test_out_of_time_a_schedule_keeps_a_valid_certificate(time_limit: float, robust_to: int):
    blocks = random_blocks(60, 4, 4, 1)
    problem = Problem(blocks, 2, (), od.MinEigenvalue(), robust_to)
    began = perf_counter()
    schedule = problem.solved(time_limit=time_limit)
    assert perf_counter() - began < 20
    assert schedule.status in (od.Status.OPTIMAL, od.Status.GAP_OPEN)
    assert (schedule.status is od.Status.OPTIMAL) == (schedule.gap <= 1e-9)
    assert schedule.value == pytest.approx(problem.values(schedule.chosen[None])[0], rel=1e-12)
    random = np.random.default_rng(0)
    others = np.stack([random_schedule(60, 4, 2, random) for _ in range(200)] + [round_robin(60, 4, 2)])
    assert max(problem.values(others).max(), schedule.value) <= schedule.bound <= schedule.root_bound
    long_enough = problem.solved(gap=1e-3, time_limit=2.0)
    assert long_enough.value <= schedule.bound * (1 + 1e-12)
    assert schedule.value <= long_enough.bound * (1 + 1e-12)


def test_other_seeds_may_only_move_what_is_left_of_the_gap():
    blocks = path_blocks(30, 2)
    found = [od.select_sensors(blocks, seed=seed, method="columns") for seed in range(3)]
    assert max(each.value for each in found) <= min(each.bound for each in found)


# ---------------------------------------------------------------- naive schedules


@pytest.mark.parametrize("per_segment", [1, 2, 3])
def test_naive_schedules_have_the_shape_and_the_counts_asked_for(per_segment: int):
    turns = round_robin(7, 3, per_segment)
    drawn = random_schedule(500, 3, per_segment, np.random.default_rng(0))
    assert turns.shape == (7, 3)
    assert drawn.shape == (500, 3)
    for schedule in (turns, drawn):
        assert schedule.dtype == bool
        np.testing.assert_array_equal(schedule.sum(axis=1), per_segment)
    # everyone's turn comes equally often, but for the last round
    assert np.ptp(turns.sum(axis=0)) <= 1
    share, expected = drawn.mean(axis=0), per_segment / 3
    np.testing.assert_allclose(share, expected, atol=5 * np.sqrt(expected * (1 - expected) / 500) + 1e-12)


def test_always_keeps_one_sensor_on_and_round_robin_goes_round():
    np.testing.assert_array_equal(single_sensor(3, 4, 2), np.tile([False, False, True, False], (3, 1)))
    np.testing.assert_array_equal(np.argmax(round_robin(5, 3), axis=1), [0, 1, 2, 0, 1])
    two_at_a_time = [np.flatnonzero(row).tolist() for row in round_robin(3, 4, 2)]
    assert two_at_a_time == [[0, 1], [2, 3], [0, 1]]


# ---------------------------------------------------------------- bad input and failing solvers


def spoiled(entry: tuple[int, ...], value: float) -> np.ndarray:
    blocks = random_blocks(3, 2, 2, 2)
    blocks[entry] = value
    return blocks


def negative(amount: float) -> np.ndarray:
    blocks = random_blocks(3, 2, 2, 2)
    blocks[1, 0] = np.diag([2.0, -amount])
    return blocks


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        (np.zeros((3, 2, 2)), r"blocks has shape \(3, 2, 2\): must be \(K, S, n, n\)"),
        (np.zeros((3, 2, 2, 3)), r"blocks has shape \(3, 2, 2, 3\)"),
        (np.zeros((0, 2, 2, 2)), r"blocks has shape \(0, 2, 2, 2\)"),
        (np.zeros((3, 0, 2, 2)), r"blocks has shape \(3, 0, 2, 2\)"),
        (spoiled((2, 1, 0, 0), np.nan), r"blocks\[2, 1\] is not finite"),
        (spoiled((0, 1, 1, 0), np.inf), r"blocks\[0, 1\] is not finite"),
        (np.array([[np.eye(2), [[2.0, 1.0], [0.5, 2.0]]]]), r"blocks\[0, 1\] is not symmetric: it differs from its transpose by 0.5 "),
        (negative(0.25), r"blocks\[1, 0\] is not positive semidefinite: its eigenvalue is -0.25 "),
    ],
)
def test_blocks_that_are_no_information_are_refused_by_index_and_amount(blocks: np.ndarray, message: str):
    with pytest.raises(od.InputError, match=message):
        od.select_sensors(blocks)


def test_rounding_errors_of_a_block_are_forgiven():
    blocks = random_blocks(3, 2, 3, 1)
    blocks[0, 0] += 1e-13 * np.triu(np.ones((3, 3)), 1) - 1e-13 * np.eye(3)
    assert od.select_sensors(blocks).status.has_answer


@pytest.mark.parametrize("per_segment", [0, -1, 3, 1.5, "1"])
def test_the_number_of_sensors_per_segment_is_checked(per_segment: object):
    with pytest.raises(od.InputError, match=rf"per_segment is {per_segment!r}: must be a whole number"):
        od.select_sensors(random_blocks(3, 2, 2, 2), per_segment)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"gap": -1e-3}, "gap is -0.001: must be a finite number of at least 0"),
        ({"gap": np.nan}, "gap is nan"),
        ({"time_limit": 0.0}, "time_limit is 0.0: must be a finite number above 0"),
        ({"time_limit": -1.0}, "time_limit is -1.0"),
        ({"seed": -1}, "seed is -1: must be a whole number of at least 0"),
    ],
)
def test_limits_are_checked(limits: dict[str, float], message: str):
    with pytest.raises(od.InputError, match=message):
        od.select_sensors(random_blocks(3, 2, 2, 2), **limits)


def test_what_is_no_choice_is_refused():
    blocks = random_blocks(3, 2, 2, 2)
    with pytest.raises(od.InputError, match="method is 'best': must be one of 'auto', 'columns', 'direct'"):
        od.select_sensors(blocks, method="best")  # pyright: ignore[reportArgumentType]
    with pytest.raises(
        od.InputError, match="criterion is Posterior: its information is no sum over sensors, so no schedule is best for it"
    ):
        od.select_sensors(blocks, criterion=od.Posterior(od.Prior(np.zeros(2), [1.0, 1.0])))
    for robust_to, accepted in ((-1, "a whole number from 0 to 1"), (2, "a whole number from 0 to 1"), (0.5, "a whole number")):
        with pytest.raises(od.InputError, match=f"robust_to is {robust_to}: must be {accepted}"):
            od.select_sensors(blocks, robust_to=robust_to)  # pyright: ignore[reportArgumentType]


class BrokenSolver:
    """Clarabel on a bad day."""

    def __init__(self, *_: object) -> None:
        self.status, self.x, self.z = "NumericalError", [], []

    def solve(self) -> BrokenSolver:
        return self


def broken_problem(*_: object, **__: object) -> None:
    raise cp.SolverError("out of luck")


@pytest.fixture
def nothing_works(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clarabel, "DefaultSolver", BrokenSolver)
    monkeypatch.setattr(cp.Problem, "solve", broken_problem)


@pytest.mark.usefixtures("nothing_works")
def test_solvers_that_fail_are_an_error_with_a_status():
    with pytest.raises(od.SolveError, match="sensor selection: stopped by a numerical error") as caught:
        od.select_sensors(random_blocks(3, 2, 2, 2))
    assert caught.value.status is od.Status.NUMERICAL_ERROR


@pytest.mark.usefixtures("nothing_works")
@pytest.mark.parametrize("criterion", CRITERIA[1:], ids=lambda each: type(each).__name__)
def test_a_criterion_with_slopes_has_a_valid_bound_even_without_a_solver(criterion: object):
    """A tangent anywhere is above the criterion everywhere."""
    problem = Problem(random_blocks(3, 2, 2, 2), 1, (), criterion, 0)  # pyright: ignore[reportArgumentType]
    schedule = problem.solved()
    certified(problem, schedule, "no solver")
    bounded_by_its_dual(problem, schedule, "no solver")


@pytest.mark.usefixtures("nothing_works")
def test_solvers_that_fail_leave_no_number_that_looks_like_an_answer():
    schedule = od.select_sensors(random_blocks(3, 2, 2, 2), throw=False)
    assert schedule.status is od.Status.NUMERICAL_ERROR
    assert not schedule.status.has_answer
    assert not schedule.chosen.any()
    assert schedule.chosen.shape == (3, 2)
    assert np.isnan([schedule.value, schedule.bound, schedule.root_bound, schedule.gap]).all()
    assert np.isnan(schedule.dual).all()


@pytest.mark.parametrize(("method", "broken"), [("auto", "columns"), ("direct", "direct")])
def test_where_one_way_fails_the_other_is_taken_and_noted(method: str, broken: str, monkeypatch: pytest.MonkeyPatch):
    if broken == "direct":
        monkeypatch.setattr(cp.Problem, "solve", broken_problem)
    else:
        monkeypatch.setattr("obsdesign.selection.relaxation.column_generation.solve_master", lambda *_: None)
    problem = Problem(PROBLEMS["full"], 1, (), od.MinEigenvalue(), 0)
    schedule = problem.solved(method=method)
    assert len(schedule.notes) == 1
    assert "failed" in schedule.notes[0]
    certified(problem, schedule, method)
    bounded_by_its_dual(problem, schedule, method)


def test_a_search_that_begins_at_its_bound_ends_there():
    """No share of the gap is left to measure falls of a bound by."""
    problem = Problem(PROBLEMS["full"], 1, (), od.MinEigenvalue(), 0)
    instance = build_problem(problem.blocks, 1, (), od.MinEigenvalue(), 0, None)
    relaxation, whole = solve_relaxation(instance, 1e-9), reduce_problem(instance, [], -np.inf)
    assert relaxation is not None
    assert whole is not None
    best_schedule = selected("full")
    at_bound = replace(relaxation, bound=best_schedule.value)
    result = search_best_first(instance, whole, at_bound, (best_schedule.chosen, best_schedule.value), 0.0, lambda: False)
    assert result.value == best_schedule.value
    assert result.bound >= best_value("full", 1) * (1 - 1e-12)


# ---------------------------------------------------------------- what reduced costs decide


def walked(walks: ReducedProblem) -> set[bytes]:
    """Every schedule of the walks."""
    found = set()

    def on(level: int, state: int, chosen: np.ndarray) -> None:
        if level == len(walks.layers):
            found.add(chosen.tobytes())
            return
        layer = walks.layers[level]
        for step in range(layer.offsets[state], layer.offsets[state + 1]):
            then = chosen.copy()
            then[layer.segment] = layer.patterns[step]
            on(level + 1, int(layer.target[step]), then)

    on(0, walks.initial_state, walks.chosen)
    return found


@pytest.mark.parametrize("rules", [(), (od.Exclusive((0, 1)),), (od.MinimumDwell(2),)], ids=["free", "groups", "chain"])
@pytest.mark.parametrize("seed", range(4))
def test_every_schedule_above_the_bar_is_left_undecided(rules: tuple[AbstractRule, ...], seed: int):
    """Reduced-cost fixing drops nothing that is better, wherever the bar is."""
    problem = Problem(random_blocks(4, 3, 3, 1, seed), 2 if rules else 1, rules, od.MinEigenvalue(), 0)
    instance = build_problem(problem.blocks, problem.per_segment, rules, od.MinEigenvalue(), 0, None)
    found = solve_relaxation(instance, 1e-9)
    assert found is not None
    chosen = feasible(problem)
    values = problem.values(chosen)
    left: set[bytes] = set()
    for least in (*np.quantile(values, [0.5, 0.9, 0.99]), values.max() - 1e-9):
        walks = reduce_problem(instance, found.evaluated_duals, float(least))
        assert walks is not None
        left = walked(walks)
        better = chosen[values > least + 1e-12]
        full = better[better.sum(axis=2).min(axis=1) == problem.per_segment] if not rules else better
        assert len(full)
        assert all(each.tobytes() in left for each in full)
    assert len(left) < len(chosen)
