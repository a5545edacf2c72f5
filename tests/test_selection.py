"""Sensor schedules against brute force, weak and strong duality, and symmetries of the problem."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import combinations, product

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import obsdesign as od
from obsdesign.selection.exchange import improved
from obsdesign.selection.naive import always, at_random, round_robin
from obsdesign.selection.schedule import best_for, information_of, largest_per_row, schedule_value, upper_bound

few = settings(deadline=None, max_examples=8, database=None, derandomize=True)
seeds = st.integers(0, 10**6)


def random_blocks(segments: int, sensors: int, n: int, rank: int, seed: int = 0) -> np.ndarray:
    factors = np.random.default_rng(seed).standard_normal((segments, sensors, n, rank))
    return factors @ factors.swapaxes(2, 3)


def path_blocks() -> np.ndarray:
    """Four segments of a turning flight with the four sensors of the paper, in the prior's units."""
    beacon = (40.0, 25.0)
    sensors = (od.GPS(2.0), od.Magnetometer(0.21), od.Range(beacon, 1.0), od.Bearing(beacon, 0.087))
    system = od.System(od.Dubins(15.0, wind="constant"), sensors)
    path = od.simulate(system, (3.0, -1.0, 0.4, 2.0, -1.0), 0.5 * np.sin(np.arange(24)), 0.25)
    units = np.array([20.0, 20.0, 0.3, 3.0, 3.0])
    return od.variational_gramian(system, path).by_segment(4) * np.outer(units, units)


PROBLEMS = {
    "rank 1": random_blocks(4, 4, 3, 1),
    "rank 1, n 5": random_blocks(5, 3, 5, 1, seed=1),
    "full": random_blocks(8, 2, 3, 3, seed=2),
    "mixed": np.concatenate([random_blocks(4, 2, 4, 1, seed=4), 0.3 * random_blocks(4, 2, 4, 4, seed=5)], axis=1),
    "path": path_blocks(),
}
every_problem = pytest.mark.parametrize("name", PROBLEMS)
one_or_two = pytest.mark.parametrize("per_segment", [1, 2])


def all_schedules(segments: int, sensors: int, per_segment: int) -> Iterator[np.ndarray]:
    """Every schedule with at most per_segment sensors per segment that no other one contains."""
    rows = [np.isin(np.arange(sensors), on) for on in combinations(range(sensors), per_segment)]
    return (np.array(schedule) for schedule in product(rows, repeat=segments))


def optimum(blocks: np.ndarray, per_segment: int) -> float:
    """lambda_min of the best schedule, by trying all: information is >= 0, so switching on never hurts."""
    schedules = np.stack(list(all_schedules(*blocks.shape[:2], per_segment)))
    return float(np.linalg.eigvalsh(np.einsum("rks,ksij->rij", schedules.astype(float), blocks))[:, 0].max())


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
def test_brute_force_lies_between_value_and_bound(name: str, per_segment: int):
    schedule, best = selected(name, per_segment), best_value(name, per_segment)
    assert schedule.value <= best * (1 + 1e-12)
    assert schedule.bound >= best * (1 - 1e-12)
    # no theorem, but what exchanges owe on problems as small as these; rounding alone loses far more
    assert schedule.value >= 0.95 * best


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


def sorted_gains(blocks: np.ndarray, Z: np.ndarray) -> np.ndarray:
    """max(tr(W_ks Z), 0), largest first in each segment."""
    gains = [[max(float(np.trace(W @ Z)), 0.0) for W in row] for row in blocks]
    return -np.sort(-np.array(gains), axis=1)


@every_problem
@one_or_two
@few
@given(seed=seeds)
def test_every_z_bounds_every_schedule(name: str, per_segment: int, seed: int):
    """Weak duality: lambda_min(W) <= <W, Z> for Z >= 0, tr Z = 1."""
    blocks = PROBLEMS[name]
    Z = random_dual(blocks.shape[2], seed)
    bound = upper_bound(blocks, Z, per_segment)
    assert bound == pytest.approx(sorted_gains(blocks, Z)[:, :per_segment].sum(), rel=1e-12)
    assert bound >= best_value(name, per_segment) * (1 - 1e-12)
    in_its_direction = information_of(blocks, best_for(blocks, Z, per_segment))
    assert np.trace(in_its_direction @ Z) == pytest.approx(bound, rel=1e-12)


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
    others = [upper_bound(blocks, 0.9 * schedule.dual + 0.1 * random_dual(4, seed)) for seed in range(50)]
    assert min(others) >= schedule.root_bound * (1 - 1e-7)


@every_problem
@pytest.mark.parametrize("share", [0.99, 1.01])
def test_optimal_is_said_only_where_the_gap_is_closed(name: str, share: float):
    """Asked for a little less and a little more than the gap that is reached."""
    gap = share * selected(name).gap
    schedule = od.select_sensors(PROBLEMS[name], gap=gap)
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
    np.testing.assert_array_equal(schedule.chosen, always(6, 2, 0))


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


@every_problem
@pytest.mark.parametrize("factor", [1e-6, 3e9])
def test_scaling_the_blocks_scales_value_and_bound(name: str, factor: float):
    plain, scaled = selected(name), od.select_sensors(factor * PROBLEMS[name])
    np.testing.assert_array_equal(plain.chosen, scaled.chosen)
    assert scaled.value == pytest.approx(factor * plain.value, rel=1e-9)
    assert scaled.bound == pytest.approx(factor * plain.bound, rel=1e-6)


@pytest.mark.parametrize("name", ["rank 1", "full", "path"])
@pytest.mark.parametrize("seed", [1, 2])
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


@every_problem
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
    assert schedule.root_bound == pytest.approx(max(upper_bound(scaled, schedule.dual), schedule.value), rel=1e-12)
    # no other Z does better: neither a single state nor a mixture
    others = [np.diag(unit) for unit in np.eye(n)] + [random_dual(n, k) for k in range(20)]
    assert schedule.root_bound <= min(upper_bound(scaled, Z) for Z in others) * (1 + 1e-6) + rounding


@one_or_two
def test_the_same_blocks_and_seed_give_the_same_bytes(per_segment: int):
    first, second = (od.select_sensors(PROBLEMS["mixed"], per_segment) for _ in range(2))
    assert first.chosen.tobytes() == second.chosen.tobytes()
    assert (first.value, first.bound, first.gap) == (second.value, second.bound, second.gap)
    assert first.dual.tobytes() == second.dual.tobytes()


# ---------------------------------------------------------------- exchange and naive schedules


@every_problem
@one_or_two
@few
@given(seed=seeds)
def test_exchange_never_worsens_keeps_the_counts_and_leaves_no_single_swap(name: str, per_segment: int, seed: int):
    blocks = PROBLEMS[name]
    K, S = blocks.shape[:2]
    first = at_random(K, S, per_segment, np.random.default_rng(seed))
    before = first.copy()
    better = improved(blocks, first, random_dual(blocks.shape[2], seed))
    np.testing.assert_array_equal(first, before)
    np.testing.assert_array_equal(better.sum(axis=1), first.sum(axis=1))
    value = schedule_value(blocks, better)
    size = np.abs(blocks).max()
    assert value >= schedule_value(blocks, first) - 1e-12 * size
    for k in range(K):
        for off, on in product(np.flatnonzero(better[k]), np.flatnonzero(~better[k])):
            other = better.copy()
            other[k, off], other[k, on] = False, True
            assert schedule_value(blocks, other) <= value + 1e-10 * size


def test_exchange_takes_two_swaps_at_once_where_one_does_not_help():
    """From (a, a) to (b, b): lambda_min is 0 after one swap alone, whichever it is."""
    first, second = np.diag([1.0, 0.0]), np.diag([0.0, 1.0])
    # segment 0 offers e1 e1' or 2 e2 e2', segment 1 offers e2 e2' or 2 e1 e1'
    blocks = np.array([[first, 2 * second], [second, 2 * first]])
    better = improved(blocks, np.array([[True, False], [True, False]]), np.eye(2) / 2)
    np.testing.assert_array_equal(better, [[False, True], [False, True]])


@pytest.mark.parametrize("per_segment", [1, 2, 3])
def test_naive_schedules_have_the_shape_and_the_counts_asked_for(per_segment: int):
    turns = round_robin(7, 3, per_segment)
    drawn = at_random(500, 3, per_segment, np.random.default_rng(0))
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
    np.testing.assert_array_equal(always(3, 4, 2), np.tile([False, False, True, False], (3, 1)))
    np.testing.assert_array_equal(np.argmax(round_robin(5, 3), axis=1), [0, 1, 2, 0, 1])
    two_at_a_time = [np.flatnonzero(row).tolist() for row in round_robin(3, 4, 2)]
    assert two_at_a_time == [[0, 1], [2, 3], [0, 1]]


@few
@given(seed=seeds, count=st.integers(1, 4))
def test_the_largest_per_row_are_no_smaller_than_the_others(seed: int, count: int):
    score = np.random.default_rng(seed).integers(0, 3, (6, 4)).astype(float)
    chosen = largest_per_row(score, count)
    np.testing.assert_array_equal(chosen.sum(axis=1), count)
    for row, on in zip(score, chosen, strict=True):
        assert row[on].min() >= max(row[~on], default=-np.inf)


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
    with pytest.raises(od.InputError, match=rf"per_segment is {per_segment!r}: must be a whole number from 1 to 2"):
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


def broken_solver(*_: object, **__: object) -> None:
    raise cp.SolverError("out of luck")


def test_a_solver_that_fails_is_an_error_with_a_status(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cp.Problem, "solve", broken_solver)
    with pytest.raises(od.SolveError, match="sensor selection: stopped by a numerical error") as caught:
        od.select_sensors(random_blocks(3, 2, 2, 2))
    assert caught.value.status is od.Status.NUMERICAL_ERROR


def test_a_solver_that_fails_leaves_no_number_that_looks_like_an_answer(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cp.Problem, "solve", broken_solver)
    schedule = od.select_sensors(random_blocks(3, 2, 2, 2), throw=False)
    assert schedule.status is od.Status.NUMERICAL_ERROR
    assert not schedule.status.has_answer
    assert not schedule.chosen.any()
    assert schedule.chosen.shape == (3, 2)
    assert np.isnan([schedule.value, schedule.bound, schedule.root_bound, schedule.gap]).all()
    assert np.isnan(schedule.dual).all()


def test_a_solver_without_time_says_so():
    schedule = od.select_sensors(random_blocks(50, 4, 4, 2), time_limit=1e-9, throw=False)
    assert schedule.status is od.Status.TIME_LIMIT
    assert np.isnan(schedule.value)
